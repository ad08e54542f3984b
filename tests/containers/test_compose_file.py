"""What the compose file denies its services; no engine is needed."""

import re

import pytest
import yaml

from tests.support.paths import ROOT

SERVICES = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]


@pytest.mark.parametrize("name", SERVICES)
def test_every_service_is_limited(name):
    service = SERVICES[name]
    assert service["mem_limit"]
    assert service["pids_limit"] >= 64
    assert service["logging"]["options"] == {"max-size": "10m", "max-file": "3"}
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]


@pytest.mark.parametrize("name", SERVICES)
def test_what_a_service_depends_on_starts_with_it(name):
    for other in SERVICES[name].get("depends_on", ()):  # compose enables no other profile for it
        assert set(SERVICES[other].get("profiles", ())) <= set(SERVICES[name].get("profiles", ()))


@pytest.mark.parametrize("name", ["scheduler", "batch-worker", "batch"])
def test_the_cluster_has_the_settings_of_a_batch_on_one_machine(name):
    from ciir.service.batch.engines import SETTINGS, name_variable

    found = {key: value for key, value in SERVICES[name]["environment"].items() if key.startswith("DASK_")}
    assert found == {name_variable(key): str(value) for key, value in SETTINGS.items()}


@pytest.mark.parametrize(
    ("given", "expected"), [("", ("web",)), ("ciir.example,b.example", ("web", "ciir.example", "b.example"))]
)
def test_the_web_service_accepts_its_own_hosts_and_the_demos(monkeypatch, given, expected):
    from ciir.service.settings import Settings

    value = SERVICES["web"]["environment"]["CIIR_HOSTS"]
    assert "${CIIR_HOSTS:-}" in value
    monkeypatch.setenv("CIIR_HOSTS", value.replace("${CIIR_HOSTS:-}", given))
    assert Settings().hosts == expected


def test_the_demo_has_the_keys_of_the_web_service():
    assert SERVICES["web"]["environment"]["CIIR_API_KEYS"] == "${CIIR_API_KEYS:-}"
    assert SERVICES["demo"]["environment"]["CIIR_API_KEYS"] == "${CIIR_API_KEYS:-}"


def test_redis_refuses_writes_before_its_container_is_out_of_memory():
    (kubernetes,) = (
        each["spec"]["template"]["spec"]["containers"][0]
        for each in yaml.safe_load_all((ROOT / "kubernetes.yaml").read_text())
        if each["kind"] == "StatefulSet"
    )
    assert (SERVICES["redis"]["mem_limit"], kubernetes["resources"]["limits"]["memory"]) == ("1g", "1Gi")
    for command in (SERVICES["redis"]["command"], kubernetes["command"]):
        assert command[command.index("--maxmemory") + 1] == "512mb"  # half: a fork that rewrites the file copies pages
        assert command[command.index("--maxmemory-policy") + 1] == "noeviction"


def test_the_web_service_can_be_given_its_proxies():
    assert SERVICES["web"]["environment"]["FORWARDED_ALLOW_IPS"] == "${FORWARDED_ALLOW_IPS:-127.0.0.1}"


def test_plain_http_is_published_on_loopback_alone():
    text = (ROOT / "docs/deployment.md").read_text()
    override = next(
        yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", text, re.S) if "keys_file" in block.lower()
    )
    assert all(port.startswith("127.0.0.1:") for port in SERVICES["web"]["ports"])
    assert "ports" not in override["services"]["web"]  # compose adds them to those of its own file
