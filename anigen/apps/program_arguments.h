#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/eval/evaluate_command.h"
#include "anigen/generate/encode.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/preprocess.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/skeleton_field/voting.h"

/// Command lines as the front half of a program hands them to its half with LibTorch. Nothing here needs LibTorch.

namespace anigen {

/// The command line of anigen-encode.
struct EncodeArguments {
  enum class Task { kStructure, kStructuredLatents, kReconstruct };
  Task task = Task::kStructure;
  generate::EncodeRequest encoded;       ///< of the first two
  generate::ReconstructRequest rebuilt;  ///< of the third
};

/// The command line of anigen-eval.
struct EvalArguments {
  eval::EvaluationRequest shapes;  ///< of --pred, as far as it is not below in the words of the command line
  std::vector<std::string> splits, lpips_weights, groups;
  std::string dataset, output, skin_ae, skins;
  std::string normalization = "centroid-rms", prediction_up = "format", dataset_up = "format", transport = "exact";
  std::size_t report_images = 4;
  bool no_icp = false, point_to_plane = false, force = false, no_report = false;
  // Sparse structures.
  std::string ss_flow, ss_dae, train_split;
  std::vector<double> guidance;  ///< scales, 1: none; empty: that of the flow's config
  std::optional<std::int64_t> steps;
  std::size_t limit = 0, views = 4;
  // Of --oracle, which reads --ss-flow and its options too; what is unset is as in anigen-generate.
  bool oracle = false;
  std::string slat_flow, slat_dae;
  std::optional<double> slat_guidance;  ///< scale, 1: none
  std::optional<std::int64_t> slat_steps;
  std::optional<float> cluster_bandwidth;
  std::optional<int> cluster_min_votes, texture_size;
  std::optional<std::size_t> hidden_views;
};

/// The command line of anigen-generate; what is unset is as the configs of the flows say.
struct GenerateArguments {
  // Images and models.
  std::string image, dataset, runs, asset_name;
  std::vector<std::filesystem::path> splits;
  std::filesystem::path structure_flow, latent_flow, structure_autoencoder, latent_autoencoder, output;
  std::size_t limit = 0;
  std::string precision = "fp32";
  bool averages = false, no_averages = false, low_memory = false, force = false, accept_other_code = false;
  // Conditions.
  std::string background = "auto", normals = "auto", structure_condition = "trained";
  std::filesystem::path normal_map, estimator_weights;
  generate::MattingOptions matting;
  // Sampling.
  std::string solver;
  std::vector<double> structure_interval, latent_interval;
  std::optional<double> structure_guidance, latent_guidance, joint_density;  ///< guidance: the scale, 1: none
  std::optional<std::int64_t> structure_steps, latent_steps;
  std::optional<int> joint_level;
  std::int64_t joints = 0;
  skeleton_field::MeanShiftOptions clustering;
  // Finishing and files.
  generate::FinishingOptions finishing;
  bool keep_hidden = false, keep_weights = false, no_smoothing = false;
  std::string axes = "gltf";
  bool obj = false, intermediate = false;
};

inline constexpr const char* kAnymate = "anymate";
inline constexpr const char* kRignet = "rignet";

/// The command line of anigen-rig.
struct RigArguments {
  std::string method, mesh, mesh_up = "format", skin, image, background = "auto", condition = "color";
  std::vector<std::string> image_splits;
  std::string joint_model, connectivity_model, skin_model;  ///< of Anymate or RigNet
  std::int64_t points = 0;
  double joint_distance = 0.0;
  rigging::RigRequest request;
  std::size_t views = 0, limit = 0;
  std::optional<std::size_t> influences;  ///< joints per vertex; 0: any number
  bool preview = false;
};

/// The command line of anigen-train.
struct TrainArguments {
  std::vector<std::string> words;  ///< argv
  std::filesystem::path config, output, load;
  std::string dataset, ckpt = "latest", warm_start;
  std::vector<std::string> overrides;
  bool restart = false, schema = false, print_config = false, tune = false;
  std::int64_t profile_steps = 0, extend_to = 0;
  // Several processes.
  int ranks = 1, rank_restarts = 0;
  double rank_timeout = 60.0;  ///< seconds without a sign of life after which a rank is lost
  std::string rendezvous, communication = "fp32";
  bool ranks_given = false;
  std::vector<std::string> only_of_ranks;  ///< options that were given and mean something to several processes alone
};

}  // namespace anigen
