#!/usr/bin/env bash
# Makes other people's readers, each in an environment of its own, from pinned sources and packages.
#
#   tools/readers.sh [READER ...]      # those named: rlbench tfds rdt droid rvt lerobot openpi gr00t sim; all without a name
#
# RPAUG_READERS is the folder they are made in (readers). What is there with today's pins is kept. RPAUG_GITHUB is where
# sources are cloned from (https://github.com); REPOSITORY.git lies there under its owner.
set -euo pipefail
checkout=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "${RPAUG_READERS:-readers}"
cd "${RPAUG_READERS:-readers}"
export GIT_LFS_SKIP_SMUDGE=1 PIP_DISABLE_PIP_VERSION_CHECK=1

# source_of FOLDER OWNER/REPOSITORY COMMIT
source_of() {
    [[ "$(git -C "$1" rev-parse HEAD 2>/dev/null)" == "$3"* ]] && return
    rm -rf "$1"
    git clone --quiet --filter=blob:none --no-checkout "${RPAUG_GITHUB:-https://github.com}/$2" "$1"
    git -C "$1" checkout --quiet "$3"
}

# environment FOLDER PYTHON PACKAGE...      torch===VERSION: no other build of it, beside which torchvision does not load
environment() {
    local folder=$1
    [ "$(cat "$folder/.pins" 2>/dev/null)" = "$*" ] && return
    rm -rf "$folder"
    "$2" -m venv "$folder"
    "$folder/bin/pip" install --quiet "${@:3}"
    echo "$*" >"$folder/.pins"
}

rlbench() {
    source_of peract_colab peract/peract_colab 3d1e573aa688e5989a82e3c5ac93d83f0f37accb
    environment venv python3.11 numpy==1.23.5 pillow==13.0.0
}

tfds() {
    environment tfds python3.11 tensorflow-cpu==2.21.0 tensorflow-datasets==4.9.10
}

rdt() {
    source_of RoboticsDiffusionTransformer thu-ml/RoboticsDiffusionTransformer deb71d82278780d83253a28d9b904085559be400
    environment rdt python3.11 numpy==1.26.4 h5py==3.16.0 pyyaml==6.0.3 opencv-python-headless==4.10.0.84
}

droid() {
    rdt
    source_of droid droid-dataset/droid 1548722f199772a43217c0d4c811c639be66e380
    source_of droid_dataset_builder kpertsch/droid_dataset_builder 8c3f83f3dfa490e670002886907f96914c5961a2
}

rvt() {
    rlbench
    source_of RVT NVlabs/RVT 91a42bfe2e3fea4f8899f7f5bfc51fecf91c8d1e
    source_of RVT/rvt/libs/YARR NVlabs/YARR f4aaeea
    source_of RVT/rvt/libs/peract NVlabs/peract 5c2988e
    rm -rf RVT/rvt/libs/peract_colab/peract_colab
    mkdir -p RVT/rvt/libs/peract_colab
    ln -s "$PWD/peract_colab" RVT/rvt/libs/peract_colab/peract_colab
    environment rvt python3.11 torch===2.13.0 numpy==1.23.5 pillow==13.0.0 scipy omegaconf einops==0.8.2 psutil==7.2.2 \
        natsort trimesh==5.2.0
    [ -d rvt_deps ] || rvt/bin/pip install --quiet --no-deps --target rvt_deps natsort psutil==7.2.2 omegaconf \
        einops==0.8.2 antlr4-python3-runtime==4.9.3 scipy pillow==13.0.0
}

lerobot() {
    source_of lerobot_src huggingface/lerobot 7427f31801f944f5ec9ce53cda02862ce7d1638b
    local pins=(
        torch===2.13.0 torchvision==0.28.0 numpy==2.2.6 pyarrow==26.0.1 pandas==2.3.3 datasets==4.8.5 av==15.1.0
        huggingface_hub==1.33.0 jsonlines==4.0.0 packaging==25.0 draccus==0.11.6 einops==0.8.2
        opencv-python-headless==5.0.0.93 deepdiff==9.1.0 safetensors==0.8.0 gymnasium==1.4.0
    )
    environment lerobot python3.12 "${pins[@]}"
    environment lerobot_rpaug python3.12 "${pins[@]}" -e "$checkout"
    for folder in lerobot lerobot_rpaug; do
        "$folder/bin/pip" install --quiet --no-deps -e lerobot_src
    done
}

openpi() {
    source_of lerobot_openpi huggingface/lerobot 0cf864870cf29f4738d3ade893e6fd13fbd7cdb5
    environment openpi python3.11 torch===2.7.1 torchvision==0.22.1 numpy==1.26.4 datasets==3.6.0 pyarrow==19.0.1 \
        av==15.1.0 jsonlines==4.0.0 packaging==24.2 huggingface-hub==0.36.2 draccus==0.10.0 einops==0.8.2 \
        opencv-python-headless==4.10.0.84 deepdiff==9.1.0 safetensors==0.8.0 imageio==2.38.1
}

gr00t() {
    source_of Isaac-GR00T NVIDIA/Isaac-GR00T 23ace64f17aa5015259b8609d371eb61a357c776
    source_of Isaac-GR00T-n1 NVIDIA/Isaac-GR00T 2196232d254b36125da0ea9bf25d9821d46b2a61
    environment gr00t python3.11 torch===2.7.1 torchvision==0.22.1 numpy==2.4.6 pandas==3.0.6 pyarrow==19.0.1 \
        opencv-python-headless==4.10.0.84 av==15.1.0 tqdm==4.70.1 decord==0.6.0 numpydantic==2.0.0
}

# robomimic, LIBERO (on robomimic 0.2, which it pins), ManiSkill, robosuite
sim() {
    source_of robomimic_now ARISE-Initiative/robomimic d309eaecc18acf4152a830a895a6984b8ac71b05
    source_of robomimic_libero ARISE-Initiative/robomimic 62ed2de905caeb9133136e4d14d810a8b6baa96c
    source_of LIBERO Lifelong-Robot-Learning/LIBERO 8f1084e3132a39270c3a13ebe37270a43ece2a01
    environment robomimic python3.11 torch===2.7.1 torchvision==0.22.1 numpy==2.4.6 h5py==3.16.0 tqdm==4.70.1 \
        termcolor==3.3.0 six==1.17.0 psutil==7.2.2 tensorboardX==2.6.5
    environment maniskill python3.11 torch===2.13.0 mani_skill==3.0.1 numpy==1.26.4
    environment robosuite python3.11 robosuite==1.5.2 mujoco==3.3.0 numpy==1.26.4 h5py==3.16.0
}

[ $# -gt 0 ] || set -- rlbench tfds rdt droid rvt lerobot openpi gr00t sim
for reader in "$@"; do
    echo "$reader" >&2
    "$reader"
done
