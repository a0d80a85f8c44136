#include "anigen/nn/profile.h"

#include <ATen/Parallel.h>
#include <ATen/record_function.h>
#include <dlfcn.h>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <system_error>
#include <unordered_map>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/openblas.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/tiles.h"

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
  if (openblas_is_slow()) {
    log::warn("OpenBLAS takes this processor for an old one, at a fifth of its speed; set OPENBLAS_CORETYPE={}",
              openblas_core());
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

// An operator that this thread is in: seconds measured inside it, work that it told, and whether one inside it had any.
struct Open {
  double inner_seconds = 0.0;
  Work work;
  bool is_outer = false;
};
thread_local std::vector<Open> open_operators;  // the innermost last

struct Began : at::ObserverContext {
  explicit Began(const Work& own) : work(own), at(Clock::now()) {}
  Work work;  // of its inputs
  Clock::time_point at;
};

// Time of backward nodes outside operators has little to tell, so it counts as one.
std::string plain_name(const std::string& name) {
  const bool node = name.rfind("autograd::engine", 0) == 0 || name.rfind("torch::autograd", 0) == 0;
  return node ? "step: backward, handing out gradients" : name;
}

bool is_any_of(const std::string& name, std::initializer_list<const char*> names) {
  return std::any_of(names.begin(), names.end(), [&](const char* one) { return name == one; });
}

// 2 · rows · depth · columns of a product of the last two of a list of matrices [(batch,) ·, ·].
double product_operations(c10::ArrayRef<const c10::IValue> inputs) {
  std::vector<Tensor> factors;
  for (const c10::IValue& value : inputs) {
    if (value.isTensor() && value.toTensor().defined()) factors.push_back(value.toTensor());
  }
  if (factors.size() < 2) return 0.0;
  const Tensor &a = factors[factors.size() - 2], &b = factors.back();
  return a.dim() < 2 || b.dim() < 1 ? 0.0 : 2.0 * static_cast<double>(a.numel()) * static_cast<double>(b.size(-1));
}

double bytes_of(c10::ArrayRef<const c10::IValue> values) {
  double bytes = 0.0;
  for (const c10::IValue& value : values) {
    if (value.isTensor() && value.toTensor().defined()) bytes += static_cast<double>(value.toTensor().nbytes());
    if (value.isTensorList()) {
      for (const Tensor& tensor : value.toTensorVector()) bytes += static_cast<double>(tensor.nbytes());
    }
  }
  return bytes;
}

// Operators of LibTorch that return another view of a tensor, or memory that nothing has written yet.
bool moves_no_bytes(const std::string& name) {
  return is_any_of(name, {"aten::view",
                          "aten::as_strided",
                          "aten::slice",
                          "aten::select",
                          "aten::transpose",
                          "aten::t",
                          "aten::expand",
                          "aten::permute",
                          "aten::narrow",
                          "aten::unsqueeze",
                          "aten::squeeze",
                          "aten::detach",
                          "detach",
                          "aten::alias",
                          "aten::unbind",
                          "aten::split_with_sizes",
                          "aten::empty",
                          "aten::empty_strided",
                          "aten::_reshape_alias",
                          "aten::resize_",
                          "aten::item",
                          "aten::_local_scalar_dense",
                          "aten::result_type",
                          "aten::resolve_conj",
                          "aten::resolve_neg",
                          "aten::lift_fresh"});
}

// Work of an operator of LibTorch on its inputs; 0 for nodes and parts of ours.
Work work_of_inputs(const at::RecordFunction& function) {
  Work work;
  const std::string name = function.name();
  if (name.rfind("aten::", 0) != 0 || moves_no_bytes(name)) return work;
  if (is_any_of(name, {"aten::mm", "aten::addmm", "aten::addmm_", "aten::bmm", "aten::baddbmm", "aten::baddbmm_"})) {
    work.fp32 = product_operations(function.inputs());
  } else {
    work.bytes = bytes_of(function.inputs());
  }
  return work;
}

// LibTorch keeps the inputs for this call alone.
std::unique_ptr<at::ObserverContext> begin_operator(const at::RecordFunction& function) {
  open_operators.emplace_back();
  return std::make_unique<Began>(work_of_inputs(function));
}

void end_operator(const at::RecordFunction& function, at::ObserverContext* context) {
  // Operators that began before the profile did have no place here.
  if (open_operators.empty() || active == nullptr) return;
  const auto* began = static_cast<Began*>(context);
  if (began == nullptr) {  // begin_operator() threw, which LibTorch only reports
    open_operators.pop_back();
    return;
  }
  const double seconds = std::chrono::duration<double>(Clock::now() - began->at).count();
  const Open done = open_operators.back();
  open_operators.pop_back();
  const std::string name = plain_name(function.name());
  Work work = done.work;
  if (began->work.fp32 > 0.0) {  // products work themselves, whatever they call beside it
    work += began->work;
  } else if (!done.is_outer && began->work.bytes > 0.0) {
    work += began->work;
    work.bytes += bytes_of(c10::ArrayRef<const c10::IValue>(function.outputs().data(), function.outputs().size()));
  }
  if (!open_operators.empty()) {
    open_operators.back().inner_seconds += seconds;
    open_operators.back().is_outer |= done.is_outer || work.fp32 + work.bf16 + work.bytes > 0.0;
  }
  const std::lock_guard<std::mutex> lock(active->mutex);
  Row& row = active->rows[name];
  ++row.calls;
  row.seconds += seconds - done.inner_seconds;
  row.work += work;
}

std::vector<Row> longest_first(std::vector<Row> rows) {
  std::sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
    return a.seconds != b.seconds ? a.seconds > b.seconds : a.name < b.name;
  });
  return rows;
}

std::string table(const std::vector<Row>& rows, const char* heading, double all, std::int64_t steps) {
  std::string text =
      std::string("| ") + heading + " | calls per step | ms per step | share | GFLOP/s |\n|---|--:|--:|--:|--:|\n";
  for (const Row& row : rows) {
    char figures[96];
    const double count = static_cast<double>(steps), operations = row.work.fp32 + row.work.bf16;
    const int length =
        std::snprintf(figures, sizeof figures, " | %.1f | %.2f | %.1f %% | ", static_cast<double>(row.calls) / count,
                      1e3 * row.seconds / count, 100.0 * row.seconds / all);
    if (operations > 0.0 && row.seconds > 0.0)
      std::snprintf(figures + length, sizeof figures - static_cast<std::size_t>(length), "%.0f",
                    1e-9 * operations / row.seconds);
    text += "| " + row.name + figures + " |\n";
  }
  return text;
}

// Seconds of the fastest of several calls, after one that warms up.
template <typename Body>
double fastest(const Body& body) {
  constexpr int kCalls = 5;
  body();
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kCalls; ++i) {
    const Clock::time_point begin = Clock::now();
    body();
    best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
  }
  return best;
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
  if (wanted >= static_cast<std::size_t>(torch::cuda::device_count()))
    throw InputError("--device", name, "this LibTorch sees no such device");
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

Work& Work::operator+=(const Work& other) {
  fp32 += other.fp32;
  bf16 += other.bf16;
  bytes += other.bytes;
  return *this;
}

bool is_profiled() { return active != nullptr; }

void count_operations(double operations, bool mixed) {
  if (open_operators.empty()) return;
  Work& work = open_operators.back().work;
  (mixed ? work.bf16 : work.fp32) += operations;
}

MachinePeak measure_machine_peak() {
  const torch::NoGradGuard no_grad;
  constexpr std::int64_t kRows = 1024, kCopied = 1 << 24;  // 64 MiB, more than caches hold
  const double operations = 2.0 * kRows * kRows * kRows;
  const Tensor a = torch::rand({kRows, kRows}), b = torch::rand({kRows, kRows});
  MachinePeak peak;
  peak.fp32 = operations / fastest([&] { at::mm(a, b); });
  if (kernels::has_bf16_products()) {
    const Tensor rounded = a.to(torch::kBFloat16), packed = torch::empty({kRows, kRows}, torch::kBFloat16);
    const Tensor sums = torch::zeros({kRows, kRows});
    kernels::pack_mixed({b.data_ptr<float>(), kRows, 1}, kRows, kRows, bf16_bits(packed));
    const std::uint16_t *from = bf16_bits(rounded), *factors = bf16_bits(packed);
    float* to = sums.data_ptr<float>();
    peak.bf16 =
        operations / fastest([&] {
          at::parallel_for(0, kRows, kRows / 16, [&](std::int64_t begin, std::int64_t end) {
            kernels::multiply_mixed(from + begin * kRows, factors, end - begin, kRows, kRows, to + begin * kRows);
          });
        });
  }
  const Tensor source = torch::zeros({kCopied}), copy = torch::zeros({kCopied});
  peak.bytes = 2.0 * static_cast<double>(source.nbytes()) / fastest([&] { copy.copy_(source); });
  return peak;
}

OperatorProfile::OperatorProfile() {
  if (active != nullptr) throw std::logic_error("there is an operator profile already");
  active = new Totals;
  callback_ = at::addGlobalCallback(
      at::RecordFunctionCallback(begin_operator, end_operator)
          .needsInputs(true)
          .needsOutputs(true)
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
  for (const auto& [name, row] : active->rows) rows.push_back({name, row.calls, row.seconds, row.work});
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
    group.work += row.work;
  }
  std::vector<Row> result;
  for (const auto& [name, row] : groups) result.push_back({name, row.calls, row.seconds, row.work});
  return longest_first(std::move(result));
}

std::string profile_markdown(const std::vector<Row>& rows, std::int64_t steps, const MachinePeak& peak) {
  constexpr std::size_t kMost = 30;  // operators
  double all = 0.0;
  Work work;
  for (const Row& row : rows) {
    all += row.seconds;
    work += row.work;
  }
  // Without products of bf16 numbers nothing was counted as such.
  const double products = work.fp32 / peak.fp32 + (peak.bf16 > 0.0 ? work.bf16 / peak.bf16 : 0.0);
  const double moved = work.bytes / peak.bytes, count = static_cast<double>(steps);
  char floor[480];
  std::snprintf(floor, sizeof floor,
                "Peak of the threads of one replica: fp32 %.0f, bf16 %.0f GFLOP/s, memory %.1f GB/s. A step multiplies "
                "%.2f GFLOP in fp32 and %.2f in bf16 and moves %.2f GB elementwise: %.0f + %.0f = %.0f ms at the peak, "
                "%.0f %% of its %.0f ms.\n\n",
                1e-9 * peak.fp32, 1e-9 * peak.bf16, 1e-9 * peak.bytes, 1e-9 * work.fp32 / count,
                1e-9 * work.bf16 / count, 1e-9 * work.bytes / count, 1e3 * products / count, 1e3 * moved / count,
                1e3 * (products + moved) / count, 100.0 * (products + moved) / all, 1e3 * all / count);
  std::vector<Row> longest = rows;
  if (longest.size() > kMost) longest.resize(kMost);
  return floor + table(OperatorProfile::by_group(rows), "group", all, steps) + "\n" +
         table(longest, "operator", all, steps);
}

}  // namespace anigen::nn
