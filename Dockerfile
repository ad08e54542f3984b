# The service as an image: no torch, no compiler, a user without rights, all that is written in /var/lib/ciir and /tmp.
#   docker build -t ciir . && docker run --rm -p 127.0.0.1:8000:8000 --read-only --tmpfs /tmp ciir
# docs/deployment.md says how to run it for others.
FROM python:3.11-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends binutils && python -m venv /opt/ciir
ENV PATH=/opt/ciir/bin:$PATH
WORKDIR /src
# Another package index than pip's own: docker build --build-arg PIP_INDEX_URL=...
ARG PIP_INDEX_URL
# First what seldom changes: the exact versions that `make lock` wrote, less what no request needs: pyrender asks for
# scipy, pyglet and imageio and uses them only for its window; matplotlib and what it asks for draws for `ciir bench`.
COPY requirements/run.txt requirements/
RUN grep -vE '^(scipy|pyglet|imageio|matplotlib|contourpy|cycler|fonttools|kiwisolver|pyparsing|python-dateutil)==' \
    requirements/run.txt > requirements/image.txt \
    && pip install --no-cache-dir --no-compile --use-pep517 --no-deps -r requirements/image.txt
COPY pyproject.toml README.md LICENSE ./
COPY ciir ciir
COPY renderer renderer
COPY models models
COPY training training
COPY service service
COPY benchmarks benchmarks
RUN pip install --no-cache-dir --no-compile --use-pep517 --no-deps . \
    # What is left over: tests, tools to make networks, what only debuggers read, pip.
    && find /opt/ciir -depth -type d -name tests -exec rm -r {} + \
    && cd /opt/ciir/lib/python*/site-packages && rm -r onnxruntime/transformers onnxruntime/quantization \
    && find swagger_ui_bundle -name '*.map' -delete \
    && strip --strip-debug imagecodecs/*.so \
    && pip uninstall --yes pip setuptools

FROM python:3.11-slim-bookworm
# OpenGL through EGL, by Mesa's software renderer: no GPU, no display.
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
    && apt-get clean && rm -rf /var/lib/apt/lists/* /var/cache/apt/*.bin
RUN groupadd --gid 10001 ciir && useradd --uid 10001 --gid ciir --no-create-home --home-dir /var/lib/ciir ciir \
    && install --directory --owner=ciir --group=ciir /var/lib/ciir
COPY --from=build /opt/ciir /opt/ciir
ENV PATH=/opt/ciir/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    CIIR_FOLDER=/var/lib/ciir \
    CIIR_CACHE=/var/lib/ciir/cache
# The demo, once: what doesn't work fails here, and what Python compiles is kept, as nothing can be written there later.
RUN export HOME=/tmp/home; ciir serve --port 48123 & server=$! \
    && python -m ciir.service.demo.over_http http://127.0.0.1:48123 /tmp/demo \
    && kill $server && wait $server && rm -r /tmp/* /var/lib/ciir/*
USER ciir
WORKDIR /var/lib/ciir
VOLUME /var/lib/ciir
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=30s \
    CMD ["python", "-c", "import urllib.request as web; web.urlopen('http://127.0.0.1:8000/healthz', timeout=2)"]
ENTRYPOINT ["ciir"]
CMD ["serve", "--host", "0.0.0.0", "--port", "8000"]
