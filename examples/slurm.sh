#!/bin/bash
# Builds a data set with eight tasks of a Slurm array, which share the folder OUT.
#
#   radarllm dataset prepare configs/data/default-data.toml --out /shared/data
#   job=$(sbatch --parsable examples/slurm.sh configs/data/default-data.toml /shared/data)
#   sbatch --dependency="afterok:$job" --wrap "radarllm dataset finish configs/data/default-data.toml --out /shared/data"
#
# A task that failed or was killed can be submitted again (`sbatch --array=3 ...`): complete shards are kept.
#SBATCH --job-name=radarllm-data
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=12:00:00
#SBATCH --requeue
# All nodes must have processors with the same instructions; where the partition is mixed, name a feature of yours.
##SBATCH --constraint=avx512
set -euo pipefail

config=${1:?usage: sbatch slurm.sh CONFIG.toml OUT}
out=${2:?usage: sbatch slurm.sh CONFIG.toml OUT}
# Not Slurm's count of tasks, which is another one when a single task is submitted again.
parts=8

exec radarllm dataset build "$config" --out "$out" \
  --shard "$SLURM_ARRAY_TASK_ID/$parts" --threads "${SLURM_CPUS_PER_TASK:-1}"
