// Waiting times of two ranks: a backward pass alone; followed by one sum of all gradients; with sums of buckets after
// it; and with buckets that are summed while it runs, in fp32 and in bf16. The communication that nothing hides is what
// a row takes more than the pass alone. Two processes of this machine over Gloo, one thread each; all rows are timed in
// turn, round after round. Prints a table; with --benchmark_out=FILE also Google Benchmark's JSON. Other --benchmark_*
// flags are accepted and ignored.
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "anigen/train/distributed/gradient_buckets.h"
#include "anigen/train/distributed/launch.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using namespace anigen::train;
using anigen::TimedTask;

constexpr int kRounds = 9;
constexpr std::int64_t kLayers = 16, kWidth = 1024, kRows = 512;
constexpr std::size_t kPassAlone = 0;

// Layers in a row, so that gradients come one after another: 64 MiB of them.
struct Work {
  Work() {
    torch::nn::Sequential layers;
    for (std::int64_t i = 0; i < kLayers; ++i) {
      layers->push_back(torch::nn::Linear(kWidth, kWidth));
      layers->push_back(torch::nn::ReLU());
    }
    net = layers;
    buffers.emplace_back(std::vector<anigen::nn::NamedModel>{{"net", net.ptr()}});
  }
  void forward() {
    buffers.front().zero_gradients();
    loss = net->forward(x).square().mean();
  }
  torch::nn::Sequential net;
  std::vector<ParameterBuffer> buffers;
  torch::Tensor x = torch::randn({kRows, kWidth}), loss;
};

std::shared_ptr<Communicator> join(int rank, const std::string& file, torch::Dtype sent) {
  LaunchEnvironment environment;
  environment.rank = rank;
  environment.size = 2;
  environment.launcher = "benchmark";
  environment.rendezvous.file = file;
  RankOptions options;
  options.sent = sent;
  return join_ranks(environment, options);
}

void run_rank(int rank, const std::string& file, const anigen::BenchmarkFlags& flags) {
  at::set_num_threads(1);
  const auto plain = join(rank, file + "-fp32", torch::kFloat32),
             rounded = join(rank, file + "-bf16", torch::kBFloat16);
  Work work;
  GradientBuckets::Options during;
  during.bytes = plain->sum_bytes();
  GradientBuckets::Options after = during;
  after.overlap = false;
  // Each way has hooks of its own; only those that expect a pass listen to it.
  GradientBuckets overlapped(work.buffers.front(), *plain, during), later(work.buffers.front(), *plain, after);
  GradientBuckets halved(work.buffers.front(), *rounded, during);
  const auto by_buckets = [&](GradientBuckets& buckets) {
    return [&] {
      buckets.expect_last_backward();
      work.loss.backward();
      buckets.start_rest(work.buffers);
      buckets.finish();
    };
  };
  const double flops = 4.0 * static_cast<double>(kLayers * kWidth * kWidth * kRows);
  std::vector<TimedTask> rows{{"backward_alone", flops, [&] { work.loss.backward(); }, anigen::kNoReference},
                              {"one_sum_afterwards", flops,
                               [&] {
                                 work.loss.backward();
                                 plain->start_sum(work.buffers.front().gradient())->wait();
                               },
                               anigen::kNoReference},
                              {"buckets_afterwards", flops, by_buckets(later), anigen::kNoReference},
                              {"buckets_overlapped", flops, by_buckets(overlapped), anigen::kNoReference},
                              {"buckets_overlapped_bf16", flops, by_buckets(halved), anigen::kNoReference}};
  const int rounds = flags.rounds(kRounds);
  for (int round = -2; round < rounds; ++round) {  // two warm up: buckets are agreed on in the first
    for (TimedTask& row : rows) {
      work.forward();
      plain->barrier();
      const auto begin = std::chrono::steady_clock::now();
      row.work();
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (round >= 0) row.seconds.push_back(seconds);
    }
  }
  plain->barrier();
  if (rank != 0) return;
  const double alone = rows[kPassAlone].median();
  std::printf("%s, %.0f MiB of gradients\n%-28s | %10s %22s\n", plain->description().c_str(),
              static_cast<double>(work.buffers.front().gradient().nbytes()) / (1 << 20), "", "ms",
              "exposed communication");
  for (const TimedTask& row : rows)
    std::printf("%-28s | %10.1f %19.1f ms\n", row.name.c_str(), 1e3 * row.median(), 1e3 * (row.median() - alone));
  if (!flags.out.empty()) anigen::write_json(flags.out, "benchmark_distributed", "distributed/", rows);
}

}  // namespace

int main(int argc, char** argv) {
  const auto flags = anigen::benchmark_flags(argc, argv);
  if (!flags) return 2;
  const std::string file =
      (std::filesystem::temp_directory_path() / "anigen-benchmark-ranks-").string() + std::to_string(::getpid());
  const pid_t child = ::fork();  // before LibTorch has started a thread
  if (child < 0) return std::fprintf(stderr, "cannot fork\n"), 1;
  int status = 0;
  try {
    run_rank(child == 0 ? 1 : 0, file, *flags);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_distributed: %s\n", error.what());
    status = 1;
  }
  if (child == 0) std::_Exit(status);
  int of_child = 0;
  ::waitpid(child, &of_child, 0);
  std::error_code ignored;
  for (const char* kind : {"-fp32", "-bf16"}) std::filesystem::remove(file + kind, ignored);
  return status != 0 ? status : (WIFEXITED(of_child) ? WEXITSTATUS(of_child) : 1);
}
