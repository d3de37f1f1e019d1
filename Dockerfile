# Drivers and workers of a Ray cluster (docs/cluster.md, docs/rayjob.yaml): Python, the package, its pinned dependencies.
#
#   docker build --tag splatreasoner .
#   docker run --rm --shm-size 2g --volume "$PWD:/data" splatreasoner demo --scenes 1 --output /data/demo
FROM python:3.11-slim AS wheel
WORKDIR /source
COPY pyproject.toml README.md ./
COPY schemas schemas
COPY pipeline pipeline
COPY workers workers
COPY jobs jobs
COPY examples/tables examples/tables
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim
COPY constraints.txt /
COPY --from=wheel /wheels /wheels
# The operator and `ray job submit` talk to the dashboard, which is in ray[default]; obstore writes to object stores.
RUN pip install --no-cache-dir --constraint /constraints.txt /wheels/*.whl 'ray[default]' obstore \
    && useradd --create-home --uid 1000 ray
USER ray
WORKDIR /data
ENTRYPOINT ["splatreasoner"]
