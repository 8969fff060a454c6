#include "palpate/cases/engines.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "palpate/cases/files.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSlurm = R"script(#!/bin/sh
# The study @NAME@ on a cluster with Slurm, which must see this folder on every node: ./slurm.sh [OPTION OF sbatch...]
# A task a case; those that a node was lost with start again; the report comes last. PALPATE: the program.
set -eu
cases=@CASES@
most=${STUDY_ARRAY:-1000} # tasks of one array (scontrol show config: MaxArraySize, less one)
program=${PALPATE:-palpate}

if [ "${SLURM_ARRAY_TASK_ID:-}" ]; then
  exec "$program" --threads "${SLURM_CPUS_PER_TASK:-1}" study run . --case $((STUDY_FIRST + SLURM_ARRAY_TASK_ID))
fi

cd "$(dirname "$0")"
mkdir -p logs
first=0
jobs=
while [ $first -lt $cases ]; do
  count=$((cases - first))
  [ $count -le "$most" ] || count=$most
  job=$(PALPATE=$program STUDY_FIRST=$first sbatch --parsable --job-name='palpate-@NAME@' --array=1-$count --ntasks=1 \
    --cpus-per-task=1 --requeue --open-mode=append --output=logs/%A-%a.log --chdir="$PWD" "$@" slurm.sh)
  jobs=$jobs:${job%%;*}
  first=$((first + count))
done
sbatch --job-name='palpate-@NAME@-report' --dependency="afterany$jobs" --ntasks=1 --output=logs/report.log \
  --chdir="$PWD" "$@" --wrap="'$program' study report ."
)script";

constexpr std::string_view kParallel = R"script(#!/bin/sh
# The study @NAME@ with GNU parallel: ./parallel.sh [OPTION OF parallel...], as --jobs 8, or --sshlogin a,b for machines
# that all see this folder. Cases that are done are left alone. PALPATE: the program.
set -eu
cd "$(dirname "$0")"
program=${PALPATE:-palpate}
seq 1 @CASES@ | parallel --joblog parallel.log --workdir "$PWD" "$@" "$program" --threads 1 study run . --case {} || true
exec "$program" study report .
)script";

constexpr std::string_view kSnakefile =
    R"script(# The study @NAME@ with Snakemake: snakemake --cores 8 --keep-going. PALPATE: the program.
import os

PROGRAM = os.environ.get("PALPATE", "palpate")


rule report:
    input: expand("cases/{case}/result/done.json", case=[f"{n:04}" for n in range(1, @CASES@ + 1)])
    output: "report.html"
    shell: "{PROGRAM:q} study report ."


rule case:
    input: "cases/{case}/case.json", "cases/{case}/scene.yaml"
    output: "cases/{case}/result/done.json"
    params: number=lambda wildcards: int(wildcards.case)
    threads: 1
    shell: "{PROGRAM:q} --threads {threads} study run . --case {params.number}"
)script";

std::string filled(std::string_view text, const std::string& name, int cases) {
  std::string out(text);
  for (const auto& [mark, value] :
       {std::pair<std::string, std::string>{"@NAME@", name}, {"@CASES@", fmt::format("{}", cases)}}) {
    for (std::size_t at = out.find(mark); at != std::string::npos; at = out.find(mark, at + value.size()))
      out.replace(at, mark.size(), value);
  }
  return out;
}

}  // namespace

void writeEngines(const fs::path& folder, const std::string& name, int cases) {
  writeIfOther(folder / "slurm.sh", filled(kSlurm, name, cases));
  writeIfOther(folder / "parallel.sh", filled(kParallel, name, cases));
  writeIfOther(folder / "Snakefile", filled(kSnakefile, name, cases));
  for (const char* script : {"slurm.sh", "parallel.sh"})
    fs::permissions(folder / script, fs::perms::owner_exec | fs::perms::group_exec | fs::perms::others_exec,
                    fs::perm_options::add);
}

}  // namespace palpate
