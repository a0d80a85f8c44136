#include "anigen/generate/learned_rigging.h"

#include <system_error>
#include <utility>

#include "anigen/anymate/heads.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/run_folder.h"

namespace anigen::generate {

namespace fs = std::filesystem;

nn::RunModel model_at(const fs::path& path, const std::string& class_name) {
  std::error_code error;
  if (fs::is_directory(path, error)) return nn::find_run_model(path, class_name);
  const std::optional<RunFolder> run = RunFolder::around(path);
  if (path.extension() != ".safetensors" || !run || !fs::is_regular_file(path, error))
    throw InputError(path.string(), "", "is no run folder and no .safetensors file of one");
  nn::RunModel found = nn::find_run_model(run->root, class_name, path.stem().string());
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

void require_finite(const Tensor& numbers, const fs::path& model) {
  if (numbers.isfinite().all().item<bool>()) return;
  throw InputError(model.string(), "", "this model gives numbers that are not finite");
}

namespace {

void require_surface(const io::RiggedShape& shape) {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
}

}  // namespace

rigging::ProposedJoints LearnedRigger::propose(const io::RiggedShape& shape, const rigging::JointProposer& given) {
  const torch::NoGradGuard no_grad;
  require_surface(shape);
  io::RiggedShape found;
  std::vector<Eigen::Vector3d>& joints = found.joints.positions;
  if (predicts_) {
    joints = predicted(shape);
    found.joints.parents = connects_ ? parents_of(shape, joints) : shortest_tree(joints);
  } else {
    rigging::ProposedJoints proposed = given.propose(shape);
    if (!connects_) return proposed;
    joints = proposed.skeleton.positions();
    found.joint_names = std::move(proposed.skeleton.names);
    found.joints.parents = parents_of(shape, joints);
  }
  Skeleton skeleton = io::to_asset(found).skeleton;
  if (predicts_) skeleton.names = joint_names(skeleton.positions(), skeleton.parents);
  return {std::move(skeleton), ""};
}

SkinWeights LearnedRigger::bind(const io::RiggedShape& shape, const Skeleton& skeleton) {
  const torch::NoGradGuard no_grad;
  require_surface(shape);
  const std::size_t vertices = shape.mesh.vertices.size();
  if (predicts_ && skeleton.size() == 1) return from_dense(std::vector<float>(vertices, 1.0F), vertices, 1);
  const SkinWeights skin = weights_of(shape, skeleton);
  return most_influences_ == 0 ? skin : limit_influences(skin, most_influences_);
}

rigging::LearnedSteps LearnedRigger::steps(const std::shared_ptr<LearnedRigger>& rigger) {
  rigging::LearnedSteps steps;
  if (rigger->predicts_ || rigger->connects_) {
    steps.propose = [rigger](const io::RiggedShape& shape, const rigging::JointProposer& given) {
      return rigger->propose(shape, given);
    };
  }
  if (rigger->binds_) {
    steps.bind = [rigger](const io::RiggedShape& shape, const Skeleton& skeleton) {
      return rigger->bind(shape, skeleton);
    };
  }
  return steps;
}

}  // namespace anigen::generate
