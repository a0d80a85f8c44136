#include "tests/parity/fixture.h"

#include <fnmatch.h>

#include <cstdio>
#include <stdexcept>
#include <utility>

#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/init.h"

namespace anigen::test {
namespace {

using torch::Tensor;

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

std::string shape_of(const Tensor& tensor) {
  std::string text;
  for (const std::int64_t size : tensor.sizes()) text += (text.empty() ? "" : "x") + std::to_string(size);
  return text.empty() ? "scalar" : text;
}

// A scalar may be stored as shape [] or [1].
bool same_shape(const Tensor& a, const Tensor& b) {
  return a.sizes() == b.sizes() || (a.numel() == 1 && b.numel() == 1 && a.dim() <= 1 && b.dim() <= 1);
}

}  // namespace

Fixture::Fixture(std::filesystem::path folder, std::string name, torch::Device device)
    : folder_(std::move(folder)),
      name_(std::move(name)),
      device_(device),
      json_(read_json(folder_ / (name_ + ".json"))) {}

const io::NamedArrays& Fixture::tensors() const {
  if (tensors_read_) return tensors_;
  std::vector<std::string> files;  // a listing of keys has none
  if (std::filesystem::exists(folder_ / (name_ + ".safetensors"))) files.push_back(name_ + ".safetensors");
  if (json_.contains("files")) files = json_.at("files").get<std::vector<std::string>>();
  for (const std::string& file : files) {
    for (auto& tensor : io::read_safetensors(folder_ / file).tensors) tensors_.push_back(std::move(tensor));
  }
  tensors_read_ = true;
  return tensors_;
}

const io::NdArray& Fixture::tensor(const std::string& key) const {
  const io::NdArray* array = io::find(tensors(), key);
  if (array == nullptr) throw std::runtime_error(name_ + " has no tensor " + key);
  return *array;
}

bool Fixture::has_input(const std::string& name) const { return io::find(tensors(), "in." + name) != nullptr; }

Tensor Fixture::input(const std::string& name) const { return nn::to_device(host_input(name), device_); }

Tensor Fixture::host_input(const std::string& name) const { return nn::to_tensor(tensor("in." + name)); }

std::vector<Tensor> Fixture::inputs(const std::string& prefix) const {
  std::vector<Tensor> list;
  while (has_input(prefix + "." + std::to_string(list.size())))
    list.push_back(input(prefix + "." + std::to_string(list.size())));
  return list;
}

Tensor Fixture::expected(const std::string& name) const { return nn::to_tensor(tensor("out." + name)); }

std::vector<std::string> Fixture::outputs() const {
  std::vector<std::string> names;
  for (const auto& [key, array] : tensors()) {
    if (starts_with(key, "out.")) names.push_back(key.substr(4));
  }
  return names;
}

io::NamedArrays Fixture::parameters() const {
  io::NamedArrays found;
  for (const auto& [key, array] : tensors()) {
    if (starts_with(key, "param.")) found.emplace_back(key.substr(6), array);
  }
  return found;
}

Fixture::Tolerance Fixture::tolerance(const std::string& output) const {
  const auto overrides = json_.find("tolerance_overrides");
  if (overrides != json_.end()) {
    for (const auto& [pattern, limits] : overrides->items()) {
      if (::fnmatch(pattern.c_str(), output.c_str(), 0) == 0) return {limits.at("atol"), limits.at("rtol")};
    }
  }
  const Json& limits = json_.at("tolerance");
  return {limits.at("atol"), limits.at("rtol")};
}

void Fixture::check(const std::string& name, const Tensor& actual) {
  checked_.insert(name);
  const Tensor wanted = expected(name);
  const Tensor found = actual.detach().to(torch::kCPU);
  if (!same_shape(found, wanted)) {
    ++failures_;
    std::printf("FAIL %-60s shape %s, expected %s\n", name.c_str(), shape_of(found).c_str(), shape_of(wanted).c_str());
    return;
  }
  if (!wanted.is_floating_point()) {
    const bool equal = torch::equal(found.to(torch::kInt64).reshape(wanted.sizes()), wanted.to(torch::kInt64));
    failures_ += equal ? 0 : 1;
    std::printf("%s %-60s %s\n", equal ? "ok  " : "FAIL", name.c_str(), equal ? "exact" : "integers differ");
    return;
  }
  const Tensor a = found.to(torch::kFloat64).reshape(wanted.sizes()), b = wanted.to(torch::kFloat64);
  const auto [atol, rtol] = tolerance(name);
  // Equal infinities and NaN in the same place agree.
  const Tensor same = (a == b).logical_or(a.isnan().logical_and(b.isnan()));
  const Tensor error = torch::where(same, torch::zeros_like(a), (a - b).abs());
  // A value that is not finite has no limit to be within: only equality counts.
  const Tensor limit = torch::where(b.isfinite(), atol + rtol * b.abs(), torch::zeros_like(b));
  const bool passed = same.logical_or(error <= limit).all().item<bool>();
  const Tensor shares = torch::where(same, torch::zeros_like(a), error / limit);
  const double worst = error.numel() > 0 ? error.max().item<double>() : 0.0;
  const double share = shares.numel() > 0 ? shares.max().item<double>() : 0.0;
  failures_ += passed ? 0 : 1;
  std::printf("%s %-60s max error %.2e = %5.1f%% of the limit (atol %.0e, rtol %.0e)\n", passed ? "ok  " : "FAIL",
              name.c_str(), worst, 100.0 * share, atol, rtol);
}

void Fixture::check_true(const std::string& what, bool ok) {
  failures_ += ok ? 0 : 1;
  std::printf("%s %s\n", ok ? "ok  " : "FAIL", what.c_str());
}

void Fixture::defer(const std::string& output, const std::string& reason) {
  checked_.insert(output);
  std::printf("not compared: %s: %s\n", output.c_str(), reason.c_str());
}

bool Fixture::finish() {
  for (const std::string& name : outputs()) {
    if (checked_.count(name) == 0) check_true(name + ": never compared", false);
  }
  return failures_ == 0;
}

}  // namespace anigen::test
