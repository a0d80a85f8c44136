// Four processes prepare one dataset folder, two are killed half way and two join later: the same bytes as by one.
//   prepare_together <anigen-prepare>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen::test;
using namespace std::chrono_literals;

std::vector<std::string> command(const std::string& program, const fs::path& out) {
  return {program, "--output",     out.string(), "--procedural",     "12",          "--procedural-test",
          "3",     "--augment",    "1",          "--views",          "3",           "--view-size",
          "48",    "--cond-views", "1",          "--cond-view-size", "32",          "--workers",
          "1",     "--threads",    "1",          "--quiet",          "--log-level", "off"};
}

/// Pieces that the processes have finished between them.
std::size_t finished_pieces(const fs::path& out) {
  std::size_t count = 0;
  std::error_code error;
  for (fs::directory_iterator entry(out / "run" / "pieces", error), end; !error && entry != end; entry.increment(error))
    count += entry->path().filename().string().rfind("prepare-", 0) == 0 && entry->path().extension() == ".json";
  return count;
}

/// @return whether it came to that before everything was done
bool wait_for_pieces(const fs::path& out, std::size_t wanted) {
  for (int i = 0; i < 6000; ++i) {
    if (finished_pieces(out) >= wanted) return true;
    std::this_thread::sleep_for(5ms);
  }
  return false;
}

void run(const std::string& program, const fs::path& folder) {
  require(run_program(command(program, folder / "alone")) == 0, "one process failed");
  const Contents alone = dataset_contents(folder / "alone");
  require(alone.count("metadata.csv") == 1 && alone.count("card.html") == 1, "the dataset is not complete");

  const fs::path out = folder / "together";
  std::vector<pid_t> doomed, staying;
  for (int i = 0; i < 2; ++i) {
    doomed.push_back(start_program(command(program, out)));
    staying.push_back(start_program(command(program, out)));
  }
  require(wait_for_pieces(out, 3), "nothing was finished in half a minute");
  for (const pid_t process : doomed) ::kill(process, SIGKILL);
  for (const pid_t process : doomed) require(wait_for(process) == -SIGKILL, "a process had ended before it was killed");
  require(finished_pieces(out) < 12, "everything was done before two were killed");
  for (int i = 0; i < 2; ++i) staying.push_back(start_program(command(program, out)));
  for (const pid_t process : staying) require(wait_for(process) == 0, "a process failed");
  require_same(alone, dataset_contents(out), "four together, two killed, two later");

  require(run_program({program, "merge", "--dataset", out.string(), "--quiet"}) == 0, "the merge failed");
  require_same(alone, dataset_contents(out), "after a merge");
  std::error_code error;
  fs::remove(fs::directory_iterator(out / "skeleton")->path() / "skeleton_voxelized.npz", error);
  require(run_program({program, "merge", "--dataset", out.string(), "--quiet"}) == 1,
          "a merge of an incomplete dataset");
  require(run_program(command(program, out)) == 0, "the repair failed");
  require_same(alone, dataset_contents(out), "after a repair");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return std::fprintf(stderr, "usage: prepare_together <anigen-prepare>\n"), 2;
  try {
    const TemporaryFolder folder;
    run(argv[1], folder.path());
    std::printf("six processes made the bytes of one\n");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "prepare_together: %s\n", error.what());
    return 1;
  }
}
