#include "anigen/nn/profile.h"

#include <ATen/record_function.h>
#include <dlfcn.h>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <system_error>
#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"

namespace anigen::nn {

namespace {

// The BLAS that LibTorch's matrix products end up in.
struct Blas {
  std::string library;  // path of the shared library that defines sgemm_, "" when there is none
  std::string flavour;  // "openblas-openmp", "openblas-pthread", "openblas-serial", "reference", "mkl", "unknown"
};

// Libraries that LibTorch links as libblas.so.3 are alternatives behind a link; its target names the package.
std::string real_path(const char* path) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(path, error);
  return error ? std::string(path) : real.string();
}

std::string flavour_of(const std::string& library) {
  const auto mentions = [&](const char* word) { return library.find(word) != std::string::npos; };
  for (const char* flavour : {"openblas-openmp", "openblas-pthread", "openblas-serial"}) {
    if (mentions(flavour)) return flavour;
  }
  if (mentions("mkl")) return "mkl";
  if (mentions("/blas/libblas")) return "reference";
  return "unknown";
}

Blas find_blas() {
  Blas blas;
  Dl_info info{};
  void* product = dlsym(RTLD_DEFAULT, "sgemm_");
  if (product != nullptr && dladdr(product, &info) != 0 && info.dli_fname != nullptr)
    blas.library = real_path(info.dli_fname);
  blas.flavour = blas.library.empty() ? "unknown" : flavour_of(blas.library);
  return blas;
}

// Says once at start when the BLAS is one that makes everything slow, and which package to install instead.
void warn_about_blas() {
  const Blas blas = find_blas();
  if (blas.flavour == "reference") {
    log::warn(
        "the reference BLAS ({}) is in use: matrix products are some 35 times slower than they could be; install "
        "libopenblas0-openmp",
        blas.library);
  } else if (blas.flavour == "openblas-pthread" || blas.flavour == "openblas-serial") {
    log::warn("{} ({}) is in use, whose threads do not get on with LibTorch's; install libopenblas0-openmp",
              blas.flavour, blas.library);
  }
}

using Clock = std::chrono::steady_clock;
using Row = OperatorProfile::Row;

// LibTorch calls plain functions, so what they write to lives here.
struct Totals {
  std::mutex mutex;
  std::unordered_map<std::string, Row> rows;
};
Totals* active = nullptr;

// Seconds measured inside each operator that this thread is in, the innermost last.
thread_local std::vector<double> inner_seconds;

struct Began : at::ObserverContext {
  Clock::time_point at = Clock::now();
};

// Time of backward nodes outside operators has little to tell, so it counts as one.
std::string plain_name(const std::string& name) {
  const bool node = name.rfind("autograd::engine", 0) == 0 || name.rfind("torch::autograd", 0) == 0;
  return node ? "step: backward, handing out gradients" : name;
}

std::unique_ptr<at::ObserverContext> begin_operator(const at::RecordFunction&) {
  inner_seconds.push_back(0.0);
  return std::make_unique<Began>();
}

void end_operator(const at::RecordFunction& function, at::ObserverContext* context) {
  // Operators that began before the profile did have no place here.
  if (inner_seconds.empty() || active == nullptr) return;
  const double seconds = std::chrono::duration<double>(Clock::now() - static_cast<Began*>(context)->at).count();
  const double own = seconds - inner_seconds.back();
  inner_seconds.pop_back();
  if (!inner_seconds.empty()) inner_seconds.back() += seconds;
  const std::lock_guard<std::mutex> lock(active->mutex);
  Row& row = active->rows[plain_name(function.name())];
  ++row.calls;
  row.seconds += own;
}

std::vector<Row> longest_first(std::vector<Row> rows) {
  std::sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
    return a.seconds != b.seconds ? a.seconds > b.seconds : a.name < b.name;
  });
  return rows;
}

std::string table(const std::vector<Row>& rows, const char* heading, double all, std::int64_t steps) {
  std::string text = std::string("| ") + heading + " | calls per step | ms per step | share |\n|---|--:|--:|--:|\n";
  for (const Row& row : rows) {
    char figures[80];
    const auto count = static_cast<double>(steps);
    std::snprintf(figures, sizeof figures, " | %.1f | %.2f | %.1f %% |\n", static_cast<double>(row.calls) / count,
                  1e3 * row.seconds / count, 100.0 * row.seconds / all);
    text += "| " + row.name + figures;
  }
  return text;
}

}  // namespace

std::string version_details() {
  const Blas blas = find_blas();
  return std::string("LibTorch ") + TORCH_VERSION + "\nBLAS " + blas.flavour +
         (blas.library.empty() ? "" : " (" + blas.library + ")") + "\nCUDA " +
         (torch::cuda::is_available() ? std::to_string(torch::cuda::device_count()) + " devices" : "not available");
}

torch::Device parse_device(const std::string& name) {
  const bool cuda = name == "cuda" || name.rfind("cuda:", 0) == 0;
  const std::string index = cuda && name.size() > 5 ? name.substr(5) : "0";
  const bool digits = !index.empty() && index.size() < 4 && index.find_first_not_of("0123456789") == std::string::npos;
  if ((name != "cpu" && !cuda) || !digits || name == "cuda:")
    throw InputError("--device", name, "expected cpu, cuda or cuda:N");
  if (!cuda) return torch::kCPU;
  const auto wanted = static_cast<std::size_t>(std::stoul(index));
  if (wanted >= torch::cuda::device_count()) throw InputError("--device", name, "this LibTorch sees no such device");
  return torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(wanted));
}

void set_up_computing(int threads) {
  keep_freed_memory();
  warn_about_blas();
  set_thread_count(threads);
  at::set_num_threads(thread_count());
  // LibTorch allows this once per process, and not after its second pool has run something.
  static const bool once = [] {
    at::set_num_interop_threads(1);
    return true;
  }();
  static_cast<void>(once);
}

OperatorProfile::OperatorProfile() {
  if (active != nullptr) throw std::logic_error("there is an operator profile already");
  active = new Totals;
  callback_ = at::addGlobalCallback(
      at::RecordFunctionCallback(begin_operator, end_operator)
          .scopes({at::RecordScope::FUNCTION, at::RecordScope::BACKWARD_FUNCTION, at::RecordScope::USER_SCOPE}));
}

OperatorProfile::~OperatorProfile() {
  at::removeCallback(callback_);
  delete active;
  active = nullptr;
}

std::vector<Row> OperatorProfile::rows() const {
  std::vector<Row> rows;
  const std::lock_guard<std::mutex> lock(active->mutex);
  for (const auto& [name, row] : active->rows) rows.push_back({name, row.calls, row.seconds});
  return longest_first(std::move(rows));
}

std::string OperatorProfile::group_of(const std::string& name) {
  const std::size_t colon = name.find(": ");
  if (colon != std::string::npos) return name.substr(0, colon);
  for (const char* product :
       {"aten::mm", "aten::addmm", "aten::bmm", "aten::baddbmm", "aten::mv", "aten::addmv", "aten::mkldnn_convolution",
        "aten::convolution_backward", "aten::slow_conv3d_forward", "aten::_slow_conv2d_forward", "aten::thnn_conv2d"}) {
    if (name == product) return "matrix products";
  }
  return "elementwise and copies";
}

std::vector<Row> OperatorProfile::by_group(const std::vector<Row>& rows) {
  std::unordered_map<std::string, Row> groups;
  for (const Row& row : rows) {
    Row& group = groups[group_of(row.name)];
    group.calls += row.calls;
    group.seconds += row.seconds;
  }
  std::vector<Row> result;
  for (const auto& [name, row] : groups) result.push_back({name, row.calls, row.seconds});
  return longest_first(std::move(result));
}

std::string profile_markdown(const std::vector<Row>& rows, std::int64_t steps) {
  constexpr std::size_t kMost = 30;  // operators
  double all = 0.0;
  for (const Row& row : rows) all += row.seconds;
  std::vector<Row> longest = rows;
  if (longest.size() > kMost) longest.resize(kMost);
  return table(OperatorProfile::by_group(rows), "group", all, steps) + "\n" + table(longest, "operator", all, steps);
}

}  // namespace anigen::nn
