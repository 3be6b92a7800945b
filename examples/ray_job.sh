#!/bin/bash
# A job of a Ray cluster, which goes on when you log out: pip install "ray[default]"; export RAY_API_SERVER_ADDRESS=http://HEAD:8265
ray job submit -- rpaug augment $PWD/data/train/open_drawer --recipe $PWD/recipe.yaml \
    --out $PWD/augmented --engine ray --address auto
