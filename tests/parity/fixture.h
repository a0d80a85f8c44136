#pragma once
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::test {

/// One parity fixture: `<name>.json` and its safetensors files. Sizes, arguments and tolerances come from there only,
/// so that a handler also passes on another folder of fixtures with other sizes.
class Fixture {
 public:
  /// Reads the JSON; tensors are read when first asked for. @param device where a handler computes
  Fixture(std::filesystem::path folder, std::string name, torch::Device device = torch::kCPU);

  const std::string& name() const { return name_; }
  const std::filesystem::path& folder() const { return folder_; }
  const Json& json() const { return json_; }
  const Json& config() const { return json_.at("config"); }
  torch::Device device() const { return device_; }

  bool has_input(const std::string& name) const;
  torch::Tensor input(const std::string& name) const;       ///< `in.<name>`, on the device
  torch::Tensor host_input(const std::string& name) const;  ///< as above, on the CPU
  /// `in.<prefix>.0`, `in.<prefix>.1`, … as many as there are
  std::vector<torch::Tensor> inputs(const std::string& prefix) const;
  torch::Tensor expected(const std::string& name) const;  ///< `out.<name>`, on the CPU
  std::vector<std::string> outputs() const;               ///< names of all expected outputs
  io::NamedArrays parameters() const;                     ///< `param.*` under their state-dict keys

  /// Compares an output and prints the largest error beside its limit. Integers must match exactly; floating-point
  /// values pass when |a-b| <= atol + rtol |expected| everywhere, with the limits of the first matching pattern of
  /// `tolerance_overrides` (shell style), else of `tolerance`.
  void check(const std::string& name, const torch::Tensor& actual);
  /// Reports something that is not a tensor comparison.
  void check_true(const std::string& what, bool ok);
  /// Names an expected output that needs a part not built yet, so that finish() does not count it.
  void defer(const std::string& output, const std::string& reason);
  /// Counts every expected output that was never compared as a failure. @return whether everything passed
  bool finish();

 private:
  struct Tolerance {
    double atol, rtol;
  };
  const io::NamedArrays& tensors() const;
  const io::NdArray& tensor(const std::string& key) const;
  Tolerance tolerance(const std::string& output) const;

  std::filesystem::path folder_;
  std::string name_;
  torch::Device device_;
  Json json_;
  mutable io::NamedArrays tensors_;
  mutable bool tensors_read_ = false;
  std::set<std::string> checked_;
  int failures_ = 0;
};

}  // namespace anigen::test
