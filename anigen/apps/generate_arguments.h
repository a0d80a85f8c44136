#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/generate/finishing.h"
#include "anigen/generate/preprocess.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen {

/// The command line of anigen-generate; negative numbers and empty words: as the configs of the flows say.
struct GenerateArguments {
  // Pictures and models.
  std::string image, dataset, checkpoint, name;
  std::vector<std::filesystem::path> splits;
  std::filesystem::path structure_flow, latent_flow, structure_autoencoder, latent_autoencoder, output;
  std::size_t most = 0;
  std::string precision = "fp32";
  bool averages = false, no_averages = false, low_memory = false, again = false, accept_other_code = false;
  bool allow_failures = false;
  // Conditions.
  std::string background = "auto", normals = "auto", structure_condition = "trained";
  std::filesystem::path normal_map, estimator_weights;
  generate::MattingOptions matting;
  // Sampling.
  std::string solver;
  std::vector<double> structure_interval, latent_interval;
  double structure_strength = -1, latent_strength = -1, joint_density = -1;
  std::int64_t structure_steps = 0, latent_steps = 0, joints = 0;
  int level = -1;
  skeleton_field::MeanShiftOptions grouping;
  // Finishing and files.
  generate::FinishingOptions finishing;
  bool keep_hidden = false, keep_weights = false, no_smoothing = false;
  bool published_axes = false, obj = false, intermediate = false;
};

}  // namespace anigen
