# The service as an image: no torch, no compiler, an unprivileged user, and writes only to /var/lib/ciir and /tmp.
#   docker build -t ciir . && docker run --rm -p 127.0.0.1:8000:8000 --read-only --tmpfs /tmp ciir
# docs/deployment.md explains how to run it for others.
FROM python:3.11-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends binutils && python -m venv /opt/ciir
ENV PATH=/opt/ciir/bin:$PATH
WORKDIR /src
# To use another package index: docker build --build-arg PIP_INDEX_URL=...
ARG PIP_INDEX_URL
COPY requirements/service.txt requirements/
RUN pip install --no-cache-dir --no-compile --use-pep517 --no-deps -r requirements/service.txt
COPY pyproject.toml README.md LICENSE ./
COPY ciir ciir
COPY renderer renderer
COPY models models
COPY training training
COPY service service
COPY benchmarks benchmarks
# Installs ciir, then removes what no request needs: tests, debug symbols, OpenGL for other platforms, tools to make
# networks, codecs of formats that are not read, all services of AWS except S3 and its logins, and pip.
RUN pip install --no-cache-dir --no-compile --use-pep517 --no-deps . \
    && find /opt/ciir -depth -type d -name tests -exec rm -r {} + \
    && find /opt/ciir/lib/python*/site-packages/swagger_ui_bundle -name '*.map' -delete \
    && cd /opt/ciir/lib/python*/site-packages \
    && rm -r onnxruntime/datasets onnxruntime/quantization onnxruntime/tools onnxruntime/transformers OpenGL/DLLS \
        OpenGL/GLES* OpenGL/WGL OpenGL/raw/GLES* OpenGL/raw/WGL pyrender/fonts \
    && rm onnxruntime/capi/libonnxruntime.so.* \
    && for codec in avif htj2k pcodec sperr sz3 ultrahdr; do rm imagecodecs/_$codec.*.so; done \
    && for library in SPERR SZ3c aom avif cpcodec openjph uhdr; do rm imagecodecs.libs/lib$library-*; done \
    && find botocore/data -mindepth 1 -maxdepth 1 -type d ! -name s3 ! -name sts ! -name 'sso*' -exec rm -r {} + \
    && rm PIL/_avif.*.so pillow.libs/libavif-* \
    && strip --strip-debug DracoPy*.so PIL/*.so av/*.so av/*/*.so h5py/*.so imagecodecs/*.so \
    && pip uninstall --yes pip setuptools

FROM python:3.11-slim-bookworm AS system
# OpenGL through EGL with Mesa's software renderer needs no GPU and no display. Mesa's drivers are one file under many names.
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
    && cd /usr/lib/*/dri && find . -type f ! -name swrast_dri.so -delete && ln -s swrast_dri.so kms_swrast_dri.so
RUN groupadd --gid 10001 ciir && useradd --uid 10001 --gid ciir --no-create-home --home-dir /var/lib/ciir ciir
COPY --from=build /opt/ciir /opt/ciir
ENV PATH=/opt/ciir/bin:$PATH
# Runs the demo once. If something doesn't work, the build fails here. Python's compiled files are kept, as nothing can be
# written there later.
RUN export HOME=/tmp/home CIIR_FOLDER=/tmp/service; ciir serve --port 48123 & server=$! \
    && python -m ciir.service.demo.over_http http://127.0.0.1:48123 /tmp/demo \
    && kill $server && wait $server && rm -r /tmp/*
# Files deleted from a base image still count towards its size, so the last stage starts empty.
RUN cd / && rm -rf var/cache/apt/* var/lib/apt/lists/* usr/share/locale usr/share/man usr/share/info \
        usr/include usr/local/include usr/share/python-wheels usr/lib/python3/dist-packages \
        usr/lib/python3*/config-* usr/local/lib/python3*/config-* usr/local/lib/python3*/ensurepip \
        usr/local/lib/python3*/idlelib usr/local/lib/python3*/site-packages/* \
    && find usr/share/doc -type f ! -name copyright -delete && find usr -name '*.a' -delete

FROM scratch
COPY --from=system / /
RUN install --directory --owner=ciir --group=ciir /var/lib/ciir
ENV PATH=/opt/ciir/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    LANG=C.UTF-8 \
    PYTHONUNBUFFERED=1 \
    CIIR_FOLDER=/var/lib/ciir
USER ciir
WORKDIR /var/lib/ciir
VOLUME /var/lib/ciir
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=30s \
    CMD ["python", "-c", "import urllib.request as web; web.urlopen('http://127.0.0.1:8000/healthz', timeout=2)"]
ENTRYPOINT ["ciir"]
CMD ["serve", "--host", "0.0.0.0", "--port", "8000"]
