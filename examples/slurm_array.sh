#!/bin/bash
#SBATCH --job-name=rpaug
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=16G
#SBATCH --time=08:00:00
#SBATCH --requeue
# Each task of the array makes a part; then `rpaug merge augmented augmented.parts/*`. Put in the queue again, a part goes on.
PART=augmented.parts/$SLURM_ARRAY_TASK_ID
rpaug augment data/train/open_drawer --recipe recipe.yaml --out $PART \
    --shard $SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT --workers $SLURM_CPUS_PER_TASK \
    $([ -e $PART ] && echo --resume)
