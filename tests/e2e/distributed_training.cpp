// anigen-train by several processes of this machine: 1, 2 and 4 of them agree; a rank that is killed stops the others
// with its name and the run goes on to the same end; another number of ranks goes on with the same samples; files of an
// earlier run in the temporary folder are in nobody's way.
//   distributed_training <anigen-train>        KILLS=10 in the environment for more than one
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/e2e/rank_run.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using anigen::test::RankRun;
using anigen::test::require;
using anigen::test::start_program;
using Clock = std::chrono::steady_clock;

void check_agreement(const RankRun& run) {
  for (const int ranks : {1, 2, 4}) run.train(ranks, "agree" + std::to_string(ranks));
  run.train(2, "rounded", "--communication bf16");
  const std::vector<double> alone = run.logged("agree1", "loss.total");
  const auto compare = [&](const std::string& output, double tolerance) {
    const std::vector<double> ours = run.logged(output, "loss.total");
    require(ours.size() == alone.size() && !ours.empty(), output + " logged other rows than one process");
    for (std::size_t i = 0; i < ours.size(); ++i) {
      require(std::abs(ours[i] - alone[i]) <= tolerance * std::abs(alone[i]),
              output + ": loss " + std::to_string(ours[i]) + ", of one process " + std::to_string(alone[i]));
    }
  };
  compare("agree2", 1e-3);
  compare("agree4", 1e-3);
  compare("rounded", 2e-2);
}

// The launcher's process id names the file by which ranks of an earlier version met; a killed run of the same id left
// it.
void check_rendezvous(const RankRun& run) {
  const fs::path temporary = run.folder / "tmp";
  fs::create_directories(temporary);
  for (const char* more : {"", "--set trainer.args.batch_size=0"}) {
    const std::string output = *more == '\0' ? "meets" : "fails";
    const pid_t launcher = start_program(run.line(2, output, more), [&] {
      const std::string stale = "anigen-ranks-" + std::to_string(::getpid()) + "-0";
      std::ofstream(temporary / stale, std::ios::binary) << std::string(64, '\x7f');
      ::setenv("TMPDIR", temporary.c_str(), 1);
    });
    int status = 0;
    require(::waitpid(launcher, &status, 0) == launcher && WIFEXITED(status), "cannot wait");
    require((WEXITSTATUS(status) == 0) == (*more == '\0'),
            output + ": status " + std::to_string(WEXITSTATUS(status)) + "\n" + anigen::read_file(run.said(output)));
    std::size_t left = 0;
    for (const auto& entry : fs::directory_iterator(temporary)) left += entry.is_directory() ? 1 : 0;
    require(left == 0, output + " left its rendezvous behind");
  }
}

// Step and micro-batch → samples, from the debug lines of all ranks.
std::map<std::string, std::string> samples_in(const fs::path& file) {
  std::map<std::string, std::string> found;
  std::istringstream text(anigen::read_file(file));
  const std::regex pattern("step ([0-9]+), micro-batch ([0-9]+): (.*)");
  for (std::string line; std::getline(text, line);) {
    std::smatch match;
    if (std::regex_search(line, match, pattern)) found[match[1].str() + "/" + match[2].str()] = match[3].str();
  }
  return found;
}

void check_data_order(const RankRun& run) {
  run.train(1, "whole", "--log-level debug");
  const auto whole = samples_in(run.said("whole"));
  require(whole.size() == 12 * 4, "not all micro-batches were logged");
  run.train(2, "start", "--set trainer.args.max_steps=6 --log-level debug");
  for (const int ranks : {1, 3}) {
    const std::string output = "then" + std::to_string(ranks);
    fs::copy(run.folder / "start", run.folder / output, fs::copy_options::recursive);
    run.train(ranks, output, "--log-level debug");
    auto legs = samples_in(run.said("start"));
    const auto second = samples_in(run.said(output));
    require(second.size() == 6 * 4, output + " did not go on from step 6");
    legs.insert(second.begin(), second.end());
    require(legs == whole, output + ": other samples than in one run");
  }
}

// Processes whose parent is this one.
std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream file(entry.path() / "stat");
    std::string stat;
    std::getline(file, stat);
    const std::size_t end = stat.rfind(')');  // of the program's name, which may hold anything
    if (end == std::string::npos) continue;
    std::istringstream rest(stat.substr(end + 1));
    std::string state;
    pid_t ppid = 0;
    rest >> state >> ppid;
    if (ppid == parent && state != "Z") found.push_back(static_cast<pid_t>(std::stol(name)));
  }
  return found;
}

void check_kills(const RankRun& run, int kills) {
  const std::string longer = "--set trainer.args.max_steps=200";
  const Clock::time_point begin = Clock::now();
  run.train(2, "unhurt", longer);
  const double whole = std::chrono::duration<double>(Clock::now() - begin).count();
  anigen::Rng rng(static_cast<std::uint64_t>(::getpid()), "rank kill moments");
  int delivered = 0;
  for (int attempt = 0; delivered < kills && attempt < 10 * kills; ++attempt) {
    const std::string output = "killed" + std::to_string(attempt);
    const pid_t launcher = start_program(run.line(2, output, longer + " --rank-restarts 1"));
    // A rank that is lost before it has met the others is missed only by the launcher, two timeouts later.
    while (!fs::exists(run.folder / output / "metrics.csv") && Clock::now() - begin < std::chrono::minutes(8))
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    std::this_thread::sleep_for(std::chrono::duration<double>(rng.uniform(0.0, 0.7) * whole));
    const std::vector<pid_t> ranks = children_of(launcher);
    const Clock::time_point killed = Clock::now();
    const bool hit = ranks.size() == 2 && ::kill(ranks[rng.index(2)], SIGKILL) == 0;
    int status = 0;
    require(::waitpid(launcher, &status, 0) == launcher, "cannot wait");
    const std::string said = anigen::read_file(run.said(output));
    require(WIFEXITED(status) && WEXITSTATUS(status) == 0, output + " did not recover:\n" + said);
    require(std::chrono::duration<double>(Clock::now() - killed).count() < 60.0 + 2.0 * whole,
            output + " took too long");
    require(run.weights(output, 200) == run.weights("unhurt", 200), output + " ended with other weights");
    if (!hit || said.find("was ended by signal 9") == std::string::npos) continue;  // it was over already
    if (said.find(" stops: rank ") != std::string::npos) ++delivered;
  }
  require(delivered >= kills, "too few kills were noticed by the other rank");
  std::printf("%d kills; the other rank named the lost one, and every run ended with the same bits\n", delivered);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: distributed_training <anigen-train>\n"), 2;
  const char* kills = std::getenv("KILLS");
  try {
    const anigen::test::TemporaryFolder folder;
    const RankRun run{argv[1], folder.path()};
    anigen::test::write_synthetic_dataset(folder / "data", 8);
    anigen::write_file_atomically(folder / "config.json", anigen::test::kSkinStageConfig);
    check_rendezvous(run);
    check_agreement(run);
    check_data_order(run);
    check_kills(run, kills != nullptr ? std::max(1, std::atoi(kills)) : 1);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "distributed_training: %s\n", error.what());
    return 1;
  }
}
