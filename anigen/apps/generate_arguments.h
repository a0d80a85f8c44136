#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/generate/finishing.h"
#include "anigen/generate/preprocess.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen {

/// The command line of anigen-generate; what is unset is as the configs of the flows say.
struct GenerateArguments {
  // Images and models.
  std::string dataset, runs, asset_name;
  std::vector<std::filesystem::path> images;
  std::vector<std::filesystem::path> splits;
  std::filesystem::path structure_flow, latent_flow, structure_autoencoder, latent_autoencoder, output;
  std::size_t limit = 0, image_views = 1;
  bool one_object = false;  ///< all images show it
  std::string precision = "fp32";
  bool averages = false, no_averages = false, low_memory = false, force = false, accept_other_code = false;
  // Conditions.
  std::string background = "auto", normals = "auto", structure_condition = "trained";
  std::filesystem::path normal_map, estimator_weights;
  generate::MattingOptions matting;
  // Sampling.
  std::string solver, view_rule = "average";
  std::vector<double> structure_interval, latent_interval;
  std::optional<double> structure_guidance, latent_guidance, joint_density;  ///< guidance: the scale, 1: none
  std::optional<std::int64_t> structure_steps, latent_steps;
  std::optional<int> joint_level;
  std::int64_t joints = 0;
  skeleton_field::MeanShiftOptions clustering;
  // Finishing and files.
  generate::FinishingOptions finishing;
  bool keep_hidden = false, keep_weights = false, no_smoothing = false;
  std::string axes = "gltf", colors = "picture";
  bool still = false, obj = false, intermediate = false;
};

}  // namespace anigen
