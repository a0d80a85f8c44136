#pragma once
#include <ATen/Parallel.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/profile.h"
#include "anigen/nn/torch.h"

namespace anigen::benchmarks {

using torch::Tensor;

/// A step of a model beside the machine's own matrix products in the same type, measured in between.
struct Timed {
  double seconds = 0.0;       ///< median of the steps
  double product_rate = 0.0;  ///< median of the products around them, FLOP/s
};

inline double seconds_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0.0 : values[values.size() / 2];
}

/// The most memory that this process has held.
inline double peak_gigabytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024.0 / 1e9;
}

/// Cheap values in place of an initialisation: a sine pattern, and ones for norms.
inline void fill_with_pattern(torch::nn::Module& model,
                              const std::function<void(const std::string& key)>& filled = {}) {
  const Tensor pattern = 0.03 * torch::sin(0.37 * torch::arange(1 << 20, torch::kFloat64)).to(torch::kFloat32);
  for (const auto& item : model.named_parameters()) {
    Tensor flat = item.value().detach().view({-1});
    const bool norm = item.key().find("norm") != std::string::npos && item.key().find("bias") == std::string::npos;
    if (norm) flat.fill_(1.0);
    for (std::int64_t done = 0; !norm && done < flat.size(0); done += pattern.size(0)) {
      const std::int64_t count = std::min(pattern.size(0), flat.size(0) - done);
      flat.narrow(0, done, count).copy_(pattern.narrow(0, 0, count));
    }
    if (filled) filled(item.key());
  }
}

/// Steps with a large product before and after each, so that both see the same machine. @param type of the product
inline Timed time_steps(int steps, torch::Dtype type, const std::function<void()>& step) {
  constexpr std::int64_t kProductSide = 2048;
  const Tensor a = torch::ones({kProductSide, kProductSide}, type), b = torch::ones_like(a);
  Tensor c = torch::empty_like(a);
  const auto product = [&] { at::mm_out(c, a, b); };
  const double flop = 2.0 * static_cast<double>(kProductSide) * kProductSide * kProductSide;
  product();
  std::vector<double> times, rates;
  for (int i = 0; i < steps; ++i) {
    rates.push_back(flop / seconds_of(product));
    times.push_back(seconds_of(step));
    rates.push_back(flop / seconds_of(product));
  }
  return {median(times), median(rates)};
}

/// One more step, operator by operator.
inline void print_profile(const std::function<void()>& step) {
  const nn::OperatorProfile profile;
  step();
  std::printf("\n%s\n", nn::profile_markdown(profile.rows(), 1, nn::measure_machine_peak()).c_str());
}

/// Prints a row and adds it to what --benchmark_out gets. @param family of the row's name in the file
inline void report_step(const std::string& family, const std::string& name, const Timed& timed, double flop,
                        Json& list) {
  const double rate = flop / timed.seconds, peak = peak_gigabytes();
  std::printf(
      "%-22s %9.2f s per step, %7.1f GFLOP/s = %5.1f %% of matrix products (%.1f GFLOP/s); peak so far %.2f GB\n",
      name.c_str(), timed.seconds, rate / 1e9, 100.0 * rate / timed.product_rate, timed.product_rate / 1e9, peak);
  list.push_back({{"name", family + "/" + name},
                  {"run_type", "iteration"},
                  {"iterations", 1},
                  {"real_time", 1e3 * timed.seconds},
                  {"cpu_time", 1e3 * timed.seconds},
                  {"time_unit", "ms"},
                  {"flop", flop},
                  {"share_of_matrix_product", rate / timed.product_rate},
                  {"peak_gigabytes", peak}});
}

inline bool read_number(const std::string& word, const std::string& name, long lowest, long& value) {
  const std::string flag = "--" + name + "=";
  if (word.compare(0, flag.size(), flag) != 0) return false;
  value = std::max(lowest, std::strtol(word.c_str() + flag.size(), nullptr, 10));
  return true;
}

inline bool read_text(const std::string& word, const std::string& name, std::string& value) {
  const std::string flag = "--" + name + "=";
  if (word.compare(0, flag.size(), flag) != 0) return false;
  value = word.substr(flag.size());
  return true;
}

/// Options that the benchmarks of both flows share.
struct FlowSettings {
  std::vector<torch::Dtype> dtypes;
  std::int64_t blocks = 24;
  int steps = 0, threads = 0;
  bool profile = false;  ///< one more step, for print_profile()
  std::string out;

  /// @return whether the word was one of these; other --benchmark_* flags are accepted and ignored
  bool read(const std::string& word) {
    long number = 0;
    if (word == "--fp32") {
      dtypes.push_back(torch::kFloat32);
    } else if (word == "--int8") {
      dtypes.push_back(torch::kInt8);
    } else if (word == "--profile") {
      profile = true;
    } else if (word == "--bf16") {
      dtypes.push_back(torch::kBFloat16);
    } else if (read_number(word, "blocks", 1, number)) {
      blocks = number;
    } else if (read_number(word, "steps", 1, number)) {
      steps = static_cast<int>(number);
    } else if (read_number(word, "threads", 1, number)) {
      threads = static_cast<int>(number);
    } else {
      return read_text(word, "benchmark_out", out) || word.compare(0, 12, "--benchmark_") == 0;
    }
    return true;
  }
};

/// Runs every type and writes the rows. @return exit status
inline int run_flow_benchmark(const std::string& family, const FlowSettings& settings,
                              const std::function<void(torch::Dtype, Json&)>& run) {
  try {
    keep_freed_memory();  // as the programs do
    at::set_num_threads(settings.threads > 0 ? settings.threads : thread_count());
    Json list = Json::array();
    for (const torch::Dtype dtype : settings.dtypes) run(dtype, list);
    if (settings.out.empty()) return 0;
    const Json json = {{"context", {{"executable", "benchmark_" + family}}}, {"benchmarks", list}};
    write_file_atomically(settings.out, json.dump(2) + "\n");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}

}  // namespace anigen::benchmarks
