// anigen-train started by Open MPI's mpirun, which says to its processes who they are in variables of its own: the same
// bits as by --ranks. Skipped where there is no mpirun.
//   launched_by_mpirun <anigen-train>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <string>

#include "tests/data/synthetic_dataset.h"
#include "tests/e2e/rank_run.h"
#include "tests/support/paths.h"

namespace {

using namespace anigen::test;

constexpr int kSteps = 12;  // of kSkinStageConfig

int check(const std::string& program) {
  const TemporaryFolder folder;
  const RankRun run{program, folder.path()};
  write_synthetic_dataset(folder / "data", 8);
  anigen::write_file_atomically(folder / "config.json", kSkinStageConfig);
  // A container has root alone, and may have fewer cores than mpirun wants for two processes.
  const std::string launcher =
      std::string("mpirun --oversubscribe ") + (::geteuid() == 0 ? "--allow-run-as-root " : "") + "-n 2 ";
  const auto said = run.said("by_mpirun");
  const int code =
      run_program(launcher + run.words("by_mpirun", "--rank-timeout 30") + " >" + quoted(said.string()) + " 2>&1");
  if (code == kSkipped) return std::printf("no mpirun (Debian: openmpi-bin)\n"), kSkipped;
  require(code == 0, "mpirun ended with " + std::to_string(code) + ":\n" + anigen::read_file(said));
  run.train(2, "by_ourselves");
  require(run.weights("by_mpirun", kSteps) == run.weights("by_ourselves", kSteps), "other weights by mpirun");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: launched_by_mpirun <anigen-train>\n"), 2;
  try {
    return check(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "launched_by_mpirun: %s\n", error.what());
    return 1;
  }
}
