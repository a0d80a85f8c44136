// anigen-train on two hosts: network namespaces of this machine, joined by a link of 1 Gbit/s and 10 ms each way. Over
// it a run ends with the bits of one on the loopback, in the time that docs/cluster.md's cost model says, and a cut of
// the link is waited out. Exits with 77 where namespaces cannot be made (no root).
//   two_hosts <anigen-train>        in the environment: CUT=20 seconds (default 2), STEPS=40 to be timed (default 4),
//                                   KEEP_WINDOW=1: TCP goes on at full speed after a pause (docs/cluster.md)
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <numeric>
#include <regex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/files.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/e2e/rank_run.h"
#include "tests/e2e/shaped_link.h"
#include "tests/support/paths.h"

namespace {

using anigen::test::RankRun;
using anigen::test::require;
using anigen::test::ShapedLink;
using Clock = std::chrono::steady_clock;

constexpr double kDelay = 0.010, kBytesPerSecond = 125e6;

void enter(const std::string& space) {
  const int file = ::open(space.c_str(), O_RDONLY | O_CLOEXEC);
  require(file >= 0 && ::setns(file, CLONE_NEWNET) == 0, "cannot enter " + space);
  if (std::getenv("KEEP_WINDOW") != nullptr) {
    std::ofstream setting("/proc/sys/net/ipv4/tcp_slow_start_after_idle");
    require(static_cast<bool>(setting << "0" << std::endl), "cannot set tcp_slow_start_after_idle");
  }
}

struct TwoHosts {
  const RankRun& run;
  ShapedLink& link;
  int port = 29600;

  std::string said(const std::string& output, int rank) const {
    return (run.folder / (output + "-" + std::to_string(rank) + ".txt")).string();
  }
  std::vector<pid_t> start(const std::string& output, const std::string& more) {
    ++port;  // of a run that has just ended it may still be taken
    std::vector<pid_t> ranks;
    for (int rank = 0; rank < 2; ++rank) {
      const std::string number = std::to_string(rank);
      const std::string line = "env RANK=" + number +
                               " WORLD_SIZE=2 LOCAL_RANK=0 LOCAL_WORLD_SIZE=1 MASTER_ADDR=" + ShapedLink::address(0) +
                               " MASTER_PORT=" + std::to_string(port) + " " + run.words(output, more) + " >" +
                               anigen::test::quoted(said(output, rank)) + " 2>&1";
      ranks.push_back(anigen::test::start_program(line, [&] { enter(link.host(rank)); }));
    }
    return ranks;
  }
  void wait(const std::vector<pid_t>& ranks, const std::string& output) const {
    bool well = true;
    for (const pid_t rank : ranks) {
      int status = 0;
      require(::waitpid(rank, &status, 0) == rank, "cannot wait");
      well = well && WIFEXITED(status) && WEXITSTATUS(status) == 0;
    }
    require(well, output + " failed:\n" + anigen::read_file(said(output, 0)) + anigen::read_file(said(output, 1)));
  }
};

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// Of the rows behind the first, in which connections are made and buckets agreed on.
double milliseconds(const RankRun& run, const std::string& output, const std::string& part) {
  const std::vector<double> all = run.logged(output, "time." + part + "_ms");
  require(all.size() > 1, output + " logged too few rows");
  return mean({all.begin() + 1, all.end()});
}

double parameters_in(const std::string& text) {
  std::smatch match;
  require(std::regex_search(text, match, std::regex("([0-9]+) trainable parameters")), "no number of parameters");
  return std::stod(match[1].str());
}

void check_throughput(TwoHosts& hosts, int steps) {
  const RankRun& run = hosts.run;
  const std::string wide =
      "--set models.model.args.decoder_config.model_channels=256 --set models.model.args.decoder_config.num_blocks=4 "
      "--set trainer.args.i_log=" +
      std::to_string(std::max(2, steps / 4)) + " --set trainer.args.max_steps=" + std::to_string(steps);
  run.train(2, "loopback", wide);
  const double before = hosts.link.bytes_carried();
  hosts.wait(hosts.start("linked", wide), "linked");
  const std::string text = anigen::read_file(hosts.said("linked", 0));
  require(text.find("Gloo over " + ShapedLink::address(0)) != std::string::npos,
          "rank 0 did not use the link:\n" + text);
  require(run.weights("linked", steps) == run.weights("loopback", steps), "other weights than over the loopback");

  const double bytes = 4.0 * parameters_in(text), carried = (hosts.link.bytes_carried() - before) / steps;
  require(carried > 2.0 * bytes, "a step sent less than its gradients");
  // docs/cluster.md, two ranks: each sends its gradients once. Buckets follow each other without a pause, so that two
  // messages of the last one and of the agreement behind it are all that waits for the delay.
  const double transfer = 1e3 * bytes / kBytesPerSecond, latency = 1e3 * 2.0 * kDelay;
  const double waited = milliseconds(run, "linked", "communication"),
               backward = milliseconds(run, "linked", "backward");
  std::printf("%.1f MB of gradients, %.1f MB carried per step; backward %.0f ms\n", bytes / 1e6, carried / 1e6,
              backward);
  std::printf(
      "communication by the cost model: %.0f ms transfer + %.0f ms latency; waited for: %.0f ms (loopback %.0f)\n",
      transfer, latency, waited, milliseconds(run, "loopback", "communication"));
  require(waited < 3.0 * (transfer + latency) + 100.0, "the link is used far worse than the cost model says");
  require(waited + backward > transfer, "faster than the link can be: it is not used");
}

void check_cut(TwoHosts& hosts, double seconds) {
  const std::string longer = "--set trainer.args.max_steps=60";
  hosts.run.train(2, "uncut", longer);
  const std::vector<pid_t> ranks = hosts.start("cut", longer);
  const std::filesystem::path metrics = hosts.run.folder / "cut" / "metrics.csv";
  const Clock::time_point begin = Clock::now();
  while (!std::filesystem::exists(metrics) && Clock::now() - begin < std::chrono::minutes(2))
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  hosts.link.cut(true);
  const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  std::this_thread::sleep_until(until);
  require(::kill(ranks.front(), 0) == 0, "the run ended without its link");
  hosts.link.cut(false);
  hosts.wait(ranks, "cut");
  require(hosts.run.weights("cut", 60) == hosts.run.weights("uncut", 60), "a cut link changed the weights");
  std::printf("a cut of %.0f s was waited out; the same bits as without\n", seconds);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: two_hosts <anigen-train>\n"), 2;
  const auto number = [](const char* name, int usual) {
    const char* text = std::getenv(name);
    return text != nullptr ? std::max(1, std::atoi(text)) : usual;
  };
  std::unique_ptr<ShapedLink> link;
  try {
    ShapedLink::Options options;
    options.bits_per_second = 8.0 * kBytesPerSecond;
    options.delay = std::chrono::milliseconds(static_cast<int>(1e3 * kDelay));
    link = std::make_unique<ShapedLink>("anigen-" + std::to_string(::getpid()), options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "two_hosts: not run, no namespaces here: %s\n", error.what());
    return anigen::test::kSkipped;
  }
  try {
    const anigen::test::TemporaryFolder folder;
    const RankRun run{argv[1], folder.path()};
    anigen::test::write_synthetic_dataset(folder / "data", 8);
    anigen::write_file_atomically(folder / "config.json", anigen::test::kSkinStageConfig);
    TwoHosts hosts{run, *link};
    check_throughput(hosts, number("STEPS", 4));
    check_cut(hosts, number("CUT", 2));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "two_hosts: %s\n", error.what());
    return 1;
  }
}
