"""kubernetes.yaml: every object as Kubernetes' own API describes it, and true to the program.

Lightkube's models are generated from that API. KEDA's object is none of it: its fields are named here, as KEDA's
resource definition (keda.sh/v1alpha1) has them. No cluster is needed.
"""

import re
from urllib.parse import urlsplit

import msgspec
import pytest
import yaml
from lightkube.core.resource_registry import resource_registry

from ciir.service.settings import Settings
from tests.support.paths import ROOT
from tests.support.web import run_app

OBJECTS = list(yaml.safe_load_all((ROOT / "kubernetes.yaml").read_text(encoding="utf-8")))
BY_NAME = {(each["kind"], each["metadata"]["name"]): each for each in OBJECTS}
WORKLOADS = [each for each in OBJECTS if each["kind"] in ("Deployment", "StatefulSet")]
OURS = [each for each in WORKLOADS if each["kind"] == "Deployment"]


class Target(msgspec.Struct):
    name: str
    kind: str | None = None


class Trigger(msgspec.Struct):
    type: str
    metadata: dict[str, str]


class ScaledObjectSpec(msgspec.Struct):
    scaleTargetRef: Target  # noqa: N815 - KEDA's names
    triggers: list[Trigger]
    minReplicaCount: int | None = None  # noqa: N815
    maxReplicaCount: int | None = None  # noqa: N815
    pollingInterval: int | None = None  # noqa: N815


class ScaledObject(msgspec.Struct):
    apiVersion: str  # noqa: N815
    kind: str
    metadata: dict[str, str]
    spec: ScaledObjectSpec


def check(given):
    """Raises `msgspec.ValidationError` for a wrong type or a missing field, `AssertionError` for an unknown field."""
    is_kedas = (given["apiVersion"], given["kind"]) == ("keda.sh/v1alpha1", "ScaledObject")
    model = ScaledObject if is_kedas else resource_registry.load(given["apiVersion"], given["kind"])
    assert leave_out_null(msgspec.to_builtins(msgspec.convert(given, model))) == given


def leave_out_null(value):
    if isinstance(value, list):
        return [leave_out_null(each) for each in value]
    if isinstance(value, dict):
        return {name: leave_out_null(each) for name, each in value.items() if each is not None}
    return value


@pytest.mark.parametrize("each", OBJECTS, ids=lambda each: f"{each['kind']} {each['metadata']['name']}")
def test_each_object_is_as_the_api_describes_it(each):
    check(each)
    assert each["kind"] == "Namespace" or each["metadata"]["namespace"] == "ciir"


def test_the_check_finds_what_is_wrong():
    web = BY_NAME["Deployment", "ciir-web"]
    without = {name: value for name, value in web["spec"].items() if name != "template"}
    for spec in (web["spec"] | {"replica": 2}, web["spec"] | {"replicas": "2"}, without):
        with pytest.raises((AssertionError, msgspec.ValidationError)):
            check(web | {"spec": spec})


def test_everything_that_is_named_is_there():
    for each in WORKLOADS:
        labels, pod = each["spec"]["template"]["metadata"]["labels"], each["spec"]["template"]["spec"]
        assert each["spec"]["selector"]["matchLabels"] == labels
        volumes = {volume["name"] for volume in pod.get("volumes", ())} | {
            claim["metadata"]["name"] for claim in each["spec"].get("volumeClaimTemplates", ())
        }
        (container,) = pod["containers"]
        assert {mount["name"] for mount in container["volumeMounts"]} == volumes
        for source in container.get("envFrom", ()):
            assert ("ConfigMap", source["configMapRef"]["name"]) in BY_NAME
        ports = {port["name"] for port in container["ports"]}
        probes = [probe for name, probe in container.items() if name.endswith("Probe") and "exec" not in probe]
        assert {next(iter(probe.values()))["port"] for probe in probes} <= ports
        for volume in pod.get("volumes", ()):
            if "persistentVolumeClaim" in volume:
                assert ("PersistentVolumeClaim", volume["persistentVolumeClaim"]["claimName"]) in BY_NAME
    pods = [each["spec"]["template"]["metadata"]["labels"] for each in WORKLOADS]
    for kind in ("Service", "NetworkPolicy"):
        for each in (each for each in OBJECTS if each["kind"] == kind):
            labels = each["spec"]["selector"] if kind == "Service" else each["spec"]["podSelector"]["matchLabels"]
            assert labels in pods
    redis = urlsplit(BY_NAME["ConfigMap", "ciir"]["data"]["CIIR_QUEUE"])
    assert BY_NAME["Service", redis.hostname]["spec"]["ports"][0]["port"] == redis.port


def test_redis_is_ready_once_it_answers_without_an_error():
    pod = BY_NAME["StatefulSet", "ciir-redis"]["spec"]["template"]["spec"]
    assert pod["containers"][0]["readinessProbe"]["exec"]["command"] == ["redis-cli", "-e", "ping"]


def test_variables_are_settings_and_no_other_begins_like_them():
    names = set(BY_NAME["ConfigMap", "ciir"]["data"])
    for each in OURS:
        pod = each["spec"]["template"]["spec"]
        names |= {variable["name"] for variable in pod["containers"][0]["env"]}
        assert pod["enableServiceLinks"] is False  # CIIR_PORT=tcp://... and others
        drain = Settings.model_fields["drain_seconds"].default
        assert pod["terminationGracePeriodSeconds"] > drain + 5
    assert names <= {f"CIIR_{name.upper()}" for name in Settings.model_fields}


def test_all_run_without_rights():
    for each in WORKLOADS:
        pod = each["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        assert pod["automountServiceAccountToken"] is False
        for container in pod["containers"]:
            assert container["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            }
            assert {"requests", "limits"} == set(container["resources"])


def test_a_container_of_workers_has_the_memory_of_all():
    (container,) = BY_NAME["Deployment", "ciir-worker"]["spec"]["template"]["spec"]["containers"]
    workers = next(int(each["value"]) for each in container["env"] if each["name"] == "CIIR_WORKERS")
    least = workers * Settings.model_fields["worker_memory_bytes"].default + (1 << 30)
    amount = container["resources"]["limits"]["memory"]
    assert amount.endswith("Gi")
    assert int(amount.removesuffix("Gi")) << 30 >= least


def test_probes_and_the_autoscaler_ask_for_what_the_server_answers(tmp_path):
    spec = BY_NAME["ScaledObject", "ciir-worker"]["spec"]
    assert ("Deployment", spec["scaleTargetRef"]["name"]) in BY_NAME
    (trigger,) = spec["triggers"]
    url = urlsplit(trigger["metadata"]["url"])
    name, namespace, _ = url.hostname.split(".")
    service = BY_NAME["Service", name]
    assert (service["metadata"]["namespace"], service["spec"]["ports"][0]["port"]) == (namespace, url.port)
    web = BY_NAME["Deployment", "ciir-web"]["spec"]["template"]["spec"]["containers"][0]
    with run_app(tmp_path, workers=0) as client:
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            assert client.get(web[probe]["httpGet"]["path"]).status_code == 200
        metrics = client.get(url.path).text
    assert re.search(rf"^{trigger['metadata']['valueLocation']} 0\.0$", metrics, re.MULTILINE)
    assert float(trigger["metadata"]["targetValue"]) > 0
