# mbd_sim on ROS 2 Jazzy: docs/how_to/containers.md says how to build and run it.
ARG ROS_DISTRO=jazzy
FROM ros:${ROS_DISTRO}-ros-base
SHELL ["/bin/bash", "-o", "pipefail", "-c"]

# gcc is only for the binaries of FMUs; venv is needed because pip may not install into the Python of Ubuntu.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends build-essential python3-venv \
    && rm -rf /var/lib/apt/lists/*

# An environment on top of that of ROS, with the packages first, so that changes of the sources do not install them again.
ENV VIRTUAL_ENV=/opt/mbd_sim
ENV PATH=/opt/mbd_sim/bin:$PATH
RUN python3 -m venv --system-site-packages "$VIRTUAL_ENV"
WORKDIR /src/mbd_sim
COPY . .
ARG EXTRAS=all
# hadolint ignore=DL3013
RUN . "/opt/ros/${ROS_DISTRO}/setup.bash" && pip install --no-cache-dir ".[${EXTRAS}]"

# Kernels that root stores here serve every user; what a user compiles is stored in a folder of his own, see below.
ENV MBD_SIM_CACHE=/opt/mbd_sim/kernels
RUN . "/opt/ros/${ROS_DISTRO}/setup.bash" && mbd_sim run double_pendulum --time 0.1 \
    && chmod -R a+rX "$MBD_SIM_CACHE"

RUN useradd --uid 1001 --create-home --shell /bin/bash simulator
USER 1001
WORKDIR /home/simulator
ENTRYPOINT ["/src/mbd_sim/scripts/in_ros"]
CMD ["sim_node"]
