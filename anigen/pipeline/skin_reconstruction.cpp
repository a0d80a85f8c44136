#include "anigen/pipeline/skin_reconstruction.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/io/checkpoint_folder.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"
#include "anigen/pipeline/device.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kVerticesAtOnce = 8192;

/// The run folder's config.json, or for a weight file the one beside it or above it (ckpts/ lies inside the run).
fs::path config_of(const fs::path& run) {
  std::error_code ignored;
  if (fs::is_directory(run, ignored)) return run / "config.json";
  const fs::path folder = fs::absolute(run).parent_path();
  return fs::exists(folder / "config.json", ignored) ? folder / "config.json" : folder.parent_path() / "config.json";
}

models::SkinAutoEncoderOptions options_of(const fs::path& file) {
  const Json config = read_json(file);
  if (config.is_object() && config.contains("models") && config["models"].is_object()) {
    for (const auto& [key, model] : config["models"].items()) {
      if (!model.is_object() || !model.contains("name") || model["name"] != "SkinAutoEncoder") continue;
      return models::SkinAutoEncoderOptions::from_json(model.contains("args") ? model["args"] : Json::object(),
                                                       file.string(), "/models/" + key + "/args");
    }
  }
  throw InputError(file.string(), "/models", "describes no model named SkinAutoEncoder");
}

}  // namespace

SkinReconstruction::SkinReconstruction(const fs::path& run, const std::string& device) : device_(parse_device(device)) {
  std::error_code ignored;
  if (!fs::exists(run, ignored)) throw InputError(run.string(), "", "no such run folder or checkpoint");
  checkpoint_ = fs::is_directory(run, ignored) ? io::choose_flow_checkpoint(run, true) : run;
  model_ = models::SkinAutoEncoder(options_of(config_of(run)), nn::Init::kNone);
  models::load_state_dict(*model_, io::read_state_dict(checkpoint_), models::LoadMode::kStrict, checkpoint_.string());
  model_->to(device_);
  model_->eval();
}

std::size_t SkinReconstruction::parameters() const {
  std::size_t count = 0;
  for (const auto& parameter : model_->parameters()) count += static_cast<std::size_t>(parameter.numel());
  return count;
}

std::vector<float> SkinReconstruction::reconstruct(const std::vector<Eigen::Vector3f>& joints,
                                                   const std::vector<int>& parents, const std::vector<float>& skin) {
  const torch::NoGradGuard no_grad;
  const auto joint_count = static_cast<std::int64_t>(joints.size());
  torch::Tensor positions = torch::empty({joint_count, 3}, torch::kFloat32);
  torch::Tensor parent_indices = torch::empty({joint_count}, torch::kInt64);
  for (std::int64_t j = 0; j < joint_count; ++j) {
    for (int k = 0; k < 3; ++k) positions.data_ptr<float>()[3 * j + k] = joints[static_cast<std::size_t>(j)][k];
    parent_indices.data_ptr<std::int64_t>()[j] = parents[static_cast<std::size_t>(j)];
  }
  const auto skeletons = models::SkeletonBatch::from_lists({positions}, {parent_indices}).to(device_);
  const auto code = model_->encode_joints(skeletons);

  std::vector<float> result(skin.size());
  const std::int64_t vertices = joint_count > 0 ? static_cast<std::int64_t>(skin.size()) / joint_count : 0;
  for (std::int64_t first = 0; first < vertices; first += kVerticesAtOnce) {
    const std::int64_t rows = std::min(kVerticesAtOnce, vertices - first);
    const torch::Tensor truth =
        torch::from_blob(const_cast<float*>(skin.data()) + first * joint_count, {rows, joint_count}, torch::kFloat32)
            .to(device_);
    const torch::Tensor features = model_->encode_vertices(code, skeletons, {truth});
    const torch::Tensor decoded =
        model_->decode(features, models::rows_of({truth}), code.features, skeletons)[0].to(torch::kCPU).contiguous();
    std::copy_n(decoded.data_ptr<float>(), rows * joint_count, result.data() + first * joint_count);
  }
  return result;
}

}  // namespace anigen::pipeline
