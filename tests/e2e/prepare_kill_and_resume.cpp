// Prepares a dataset, kills the program or one of its workers at random moments, starts it again, and compares the end
// with an uninterrupted run, byte for byte; two shards and a merge too.
//   prepare_kill_and_resume <anigen-prepare> [features]     KILLS=20 in the environment for more than the default of 4
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "anigen/core/random.h"
#include "anigen/creatures/body.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen::test;
using Clock = std::chrono::steady_clock;

struct Setup {
  std::string program;
  fs::path folder;
  bool features;

  /// Everything the program can do, small: rigged files, one of them broken and one twice, creatures, variants, views.
  std::vector<std::string> command(const std::string& out, const std::vector<std::string>& more = {},
                                   const std::string& workers = "2") const {
    std::vector<std::string> words{program,
                                   "--output",
                                   (folder / out).string(),
                                   "--input",
                                   (folder / "in").string(),
                                   "--procedural",
                                   "2",
                                   "--augment",
                                   "1",
                                   "--test-count",
                                   "1",
                                   "--views",
                                   "2",
                                   "--view-size",
                                   "32",
                                   "--cond-views",
                                   "1",
                                   "--cond-view-size",
                                   "24",
                                   "--workers",
                                   workers,
                                   "--keep-going",
                                   "--quiet",
                                   "--log-level",
                                   "off"};
    if (features) words.insert(words.end(), {"--features", "surface"});
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
};

void write_inputs(const fs::path& folder) {
  for (std::size_t i = 0; i < 3; ++i)
    anigen::io::write_gltf(folder / ("creature" + std::to_string(i) + ".glb"), anigen::creatures::make_creature(77, i));
  fs::copy_file(folder / "creature0.glb", folder / "twin.glb");
  const std::string whole = anigen::read_file(folder / "creature1.glb");
  anigen::write_file_atomically(folder / "cut off.glb", whole.substr(0, whole.size() / 3));
}

/// Runs a command until it ends by itself, killing it or its workers `kills` times on the way.
void run_under_fire(const std::vector<std::string>& command, int kills, double typical_seconds, anigen::Rng& rng) {
  for (int delivered = 0;;) {
    const pid_t child = start_program(command);
    if (delivered < kills) {
      std::this_thread::sleep_for(std::chrono::duration<double>(rng.uniform(0.02, 0.7) * typical_seconds));
      const std::vector<pid_t> workers = children_of(child);
      if (!workers.empty() && rng.chance(0.3)) {
        // One worker, as the kernel does when memory is short: the run itself goes on.
        ::kill(workers[rng.index(workers.size())], SIGKILL);
        ++delivered;
        std::this_thread::sleep_for(std::chrono::duration<double>(rng.uniform(0.02, 0.3) * typical_seconds));
      }
      ::kill(child, SIGKILL);
    }
    const int status = wait_for(child);
    require(status == 0 || status == -SIGKILL, "a resumed run failed with status " + std::to_string(status));
    delivered += status == -SIGKILL;
    if (status == 0 && delivered >= kills) return;
  }
}

void run(const Setup& setup, int kills) {
  write_inputs(setup.folder / "in");
  const Clock::time_point begin = Clock::now();
  require(run_program(setup.command("whole")) == 0, "the uninterrupted run failed");
  const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  const Contents whole = dataset_contents(setup.folder / "whole");
  require(whole.count("metadata.csv") == 1 && whole.count("card.html") == 1, "the dataset is not complete");
  std::printf("%zu files in %.1f s\n", whole.size(), seconds);

  require(run_program(setup.command("one worker", {"--threads", "1"}, "1")) == 0, "one worker failed");
  require_same(whole, dataset_contents(setup.folder / "one worker"), "one worker");

  anigen::Rng rng(static_cast<std::uint64_t>(::getpid()), "kill moments");
  run_under_fire(setup.command("killed"), kills, seconds, rng);
  require_same(whole, dataset_contents(setup.folder / "killed"), "after kills");

  // Two shards at once, each killed once; a merge before the end must refuse.
  const std::vector<std::string> merge{setup.program, "merge", "--dataset", (setup.folder / "shards").string(),
                                       "--quiet"};
  run_under_fire(setup.command("shards", {"--shard", "0/2"}), 1, seconds / 2, rng);
  require(run_program(merge) == 2, "a merge of one of two shards did not refuse");
  run_under_fire(setup.command("shards", {"--shard", "1/2"}), 1, seconds / 2, rng);
  require(run_program(merge) == 0, "the merge failed");
  require_same(whole, dataset_contents(setup.folder / "shards"), "two shards");

  // A budget that no asset fits in: everything is a named failure, and stays one until a retry is asked for.
  require(run_program(setup.command("tight", {"--memory-mb", "2"})) == 2, "a run in 2 MB did not fail");
  require(run_program(setup.command("tight", {"--retry-failed"})) == 0, "the retry failed");
  require_same(whole, dataset_contents(setup.folder / "tight"), "after a retry");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return std::fprintf(stderr, "usage: prepare_kill_and_resume <anigen-prepare> [features]\n"), 2;
  const char* kills = std::getenv("KILLS");
  try {
    const TemporaryFolder folder;
    run({argv[1], folder.path(), argc > 2}, kills != nullptr ? std::max(1, std::atoi(kills)) : 4);
    std::printf("every interrupted run ended with the same bytes\n");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "prepare_kill_and_resume: %s\n", error.what());
    return 1;
  }
}
