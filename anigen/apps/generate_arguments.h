#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/engine/generator.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/preprocess.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen {

/// The command line of anigen-generate; what is unset is as the configs of the flows say.
struct GenerateArguments {
  engine::GeneratorOptions models;
  engine::GenerateOptions sampling;  ///< without contents of mask and voxels
  // Images and further models.
  std::string dataset, asset_name;
  std::vector<std::filesystem::path> images;
  std::vector<std::filesystem::path> splits;
  std::filesystem::path structure_autoencoder, latent_autoencoder, output;
  std::size_t limit = 0, image_views = 1;
  bool one_object = false;  ///< all images show it
  bool averages = false, no_averages = false, force = false, accept_other_code = false;
  // Conditions.
  std::filesystem::path mask;
  std::string normals = "auto", structure_condition = "trained";
  std::filesystem::path normal_map, estimator_weights;
  generate::MattingOptions matting;
  // Further options of sampling.
  std::filesystem::path voxels;  ///< of an earlier call
  std::string solver, view_rule = "average";
  std::vector<double> structure_interval, latent_interval;
  std::optional<double> joint_density, velocity_tolerance;
  std::optional<std::int64_t> guidance_every, windowed_steps;
  std::optional<int> joint_level;
  skeleton_field::MeanShiftOptions clustering;
  // Finishing and files.
  generate::FinishingOptions finishing;
  bool keep_hidden = false, keep_weights = false, no_smoothing = false;
  std::string axes = "gltf", colors = "picture";
  bool still = false, obj = false, intermediate = false;
};

}  // namespace anigen
