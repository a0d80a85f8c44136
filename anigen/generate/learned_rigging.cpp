#include "anigen/generate/learned_rigging.h"

#include <cstdint>
#include <system_error>
#include <utility>

#include "anigen/anymate/heads.h"
#include "anigen/asset/skeleton.h"

namespace anigen::generate {

namespace fs = std::filesystem;

fs::path run_around(const fs::path& file) {
  std::error_code error;
  const fs::path folder = fs::absolute(file).lexically_normal().parent_path();
  for (const fs::path& run : {folder, folder.filename() == "ckpts" ? folder.parent_path() : folder}) {
    if (fs::is_regular_file(run / "config.json", error)) return run;
  }
  return {};
}

nn::RunModel model_at(const fs::path& path, const std::string& class_name) {
  std::error_code error;
  if (fs::is_directory(path, error)) return nn::find_run_model(path, class_name);
  const fs::path run = run_around(path);
  if (path.extension() != ".safetensors" || run.empty() || !fs::is_regular_file(path, error)) {
    throw InputError(path.string(), "", "is no run folder and no .safetensors file of one");
  }
  nn::RunModel found = nn::find_run_model(run, class_name, path.stem().string());
  found.checkpoint = path;
  return found;
}

using torch::Tensor;

RigBones bones_between(const Tensor& joints, const std::vector<int>& parents) {
  RigBones found;
  std::vector<std::int64_t> parent;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    parent.push_back(parents[j] < 0 ? static_cast<std::int64_t>(j) : parents[j]);
    if (parents[j] >= 0) found.heads.push_back(parents[j]);
  }
  found.bones = anymate::bones_of(joints, torch::tensor(parent, torch::kInt64));
  return found;
}

RigBones bones_of_rig(const Tensor& joints, const std::vector<int>& parents) {
  const auto count = static_cast<std::int64_t>(parents.size());
  Tensor tails = torch::zeros({count, 3});
  std::vector<std::int64_t> children(parents.size(), 0);
  RigBones found;
  for (std::int64_t j = 0; j < count; ++j) {
    found.heads.push_back(static_cast<int>(j));
    const int parent = parents[static_cast<std::size_t>(j)];
    if (parent < 0) continue;
    tails[parent] += joints[j];
    ++children[static_cast<std::size_t>(parent)];
  }
  for (std::int64_t j = 0; j < count; ++j) {
    const std::int64_t own = children[static_cast<std::size_t>(j)];
    const int parent = parents[static_cast<std::size_t>(j)];
    if (own > 0) {
      tails[j] /= static_cast<double>(own);
    } else {
      tails[j] = joints[j];
      if (parent >= 0) tails[j] += 0.5 * (joints[j] - joints[parent]);
    }
  }
  found.bones = torch::cat({joints, tails}, 1);
  return found;
}

rigging::ProposedJoints propose_by_models(const io::RiggedShape& shape, const rigging::JointProposer& given,
                                          const JointModels& models) {
  io::RiggedShape found;
  if (models.predict) {
    found.joints.positions = models.predict();
    found.joints.parents =
        models.connect ? models.connect(found.joints.positions) : shortest_tree(found.joints.positions);
  } else {
    rigging::ProposedJoints proposed = given.propose(shape);
    if (!models.connect) return proposed;
    found.joints.positions = proposed.skeleton.positions();
    found.joint_names = std::move(proposed.skeleton.names);
    found.joints.parents = models.connect(found.joints.positions);
  }
  Skeleton skeleton = io::to_asset(found).skeleton;
  if (models.predict) skeleton.names = joint_names(skeleton.positions(), skeleton.parents);
  return {std::move(skeleton), ""};
}

}  // namespace anigen::generate
