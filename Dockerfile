# The web app on a CPU: `make image`, then `docker run -p 7860:7860 dipcg`.
FROM python:3.11-slim
WORKDIR /dipcg
COPY . .
ARG TORCH=cpu
ENV UV_CACHE_DIR=/cache UV_LINK_MODE=copy UV_COMPILE_BYTECODE=1 PIP_NO_CACHE_DIR=1 PATH=/dipcg/.venv/bin:$PATH
# Only the installation needs the compiler.
RUN --mount=type=cache,target=/cache --mount=type=cache,target=/var/lib/apt/lists \
    apt-get update && apt-get install -y --no-install-recommends make && \
    make install EXTRAS=infinigen,app,heic,usd,words && \
    apt-get purge -y g++ make && apt-get autoremove -y
RUN useradd --create-home dipcg
USER dipcg
EXPOSE 7860
CMD ["dipcg", "serve", "--host", "0.0.0.0"]
