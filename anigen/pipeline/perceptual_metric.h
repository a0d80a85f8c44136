#pragma once
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/io/image.h"
#include "anigen/models/lpips.h"

namespace anigen::pipeline {

/// LPIPS between two pictures, for programs that know pictures and no tensors (models/lpips.h says what it is).
class PerceptualMetric {
 public:
  /// @param weights one file or several that together hold trunk and heads (models/lpips_weights.h)
  /// @param device "cpu", "cuda" or "cuda:N"
  /// @throws InputError when a file is missing, damaged or lacks weights, or the device is not available
  explicit PerceptualMetric(const std::vector<std::filesystem::path>& weights, const std::string& device = "cpu");

  /// Colours as they are stored (sRGB); alpha is ignored. May be called from several threads, which then take turns:
  /// the features of one pair of 512² pictures are half a gigabyte.
  /// @throws InputError when the pictures differ in size or are smaller than 16 × 16
  double distance(const io::Image& a, const io::Image& b);

  /// What decides the numbers: network, and the SHA-256 of every file in the order given.
  const Json& describe() const { return description_; }

 private:
  std::mutex mutex_;
  torch::Device device_;
  models::Lpips lpips_;
  Json description_;
};

}  // namespace anigen::pipeline
