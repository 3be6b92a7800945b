#!/bin/bash
#SBATCH --job-name=rpaug
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=4
#SBATCH --mem=16G
#SBATCH --time=08:00:00
#SBATCH --requeue
# A Ray cluster of the job's nodes, and one run on all of it. Put in the queue again, the run goes on.
HEAD=$(scontrol show hostnames $SLURM_JOB_NODELIST | head -n 1)
PORT=$((20000 + SLURM_JOB_ID % 10000))
srun -N 1 -n 1 -w $HEAD ray start --head --port $PORT --num-cpus $SLURM_CPUS_PER_TASK --block &
sleep 30
srun -N $((SLURM_NNODES - 1)) -n $((SLURM_NNODES - 1)) -x $HEAD \
    ray start --address $HEAD:$PORT --num-cpus $SLURM_CPUS_PER_TASK --block &
sleep 30
rpaug augment data/train/open_drawer --recipe recipe.yaml --out augmented \
    --engine ray --address $HEAD:$PORT $([ -e augmented ] && echo --resume)
