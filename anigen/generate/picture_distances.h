#pragma once
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/image.h"
#include "anigen/nn/torch.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/lpips.h"

namespace anigen::generate {

// Learned distances between two pictures, for programs that know pictures and no tensors. Colours are as they are
// stored (sRGB); alpha is ignored. Several threads may call distance(), and take turns.

/// LPIPS (vision/lpips.h).
class LpipsDistance {
 public:
  /// @param weights one file or several that together hold trunk and heads (vision/lpips.h)
  /// @param device "cpu", "cuda" or "cuda:N"
  /// @throws InputError when a file is missing, damaged or lacks weights, or the device is not available
  explicit LpipsDistance(const std::vector<std::filesystem::path>& weights, const std::string& device = "cpu");

  /// The features of one pair of 512² pictures are half a gigabyte.
  /// @throws InputError when the pictures differ in size or are smaller than 16 × 16
  double distance(const io::Image& a, const io::Image& b);

  /// Inputs that decide the numbers: network, and the SHA-256 of every file in the order given.
  const Json& describe() const { return description_; }

 private:
  std::mutex mutex_;
  torch::Device device_;
  vision::Lpips lpips_;
  Json description_;
};

/// Distance of what a flow's image encoder sees: 1 − cos of both pictures' tokens, a mean over the tokens; from 0, the
/// same, to 2. No LPIPS: the encoder was trained to tell shapes and rigs.
class EncoderDistance {
 public:
  /// @param flow run folder of stage 4 or 5 @param device as LpipsDistance
  /// @throws InputError when the run is unusable, was trained without images or on normals, or the device is not
  /// available
  explicit EncoderDistance(const std::filesystem::path& flow, const std::string& device = "cpu");

  /// The pictures are resized to those of the flow's training. @throws InputError when they differ in size
  double distance(const io::Image& a, const io::Image& b);

  /// Inputs that decide the numbers: SHA-256 of the flow's config, its encoder's weights and those that this one asks.
  const Json& describe() const { return description_; }

 private:
  std::mutex mutex_;
  vision::FlowEncoder flow_;
  Json description_;
};

}  // namespace anigen::generate
