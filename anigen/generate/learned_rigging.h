#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::generate {

/// Folders of the models of a learned rigger; an empty path: no such model.
struct LearnedModelFiles {
  std::filesystem::path joints, connectivity, skin;
};

/// The folder of the run that a file of weights belongs to, its own or that of its ckpts/; empty when there is none.
std::filesystem::path run_around(const std::filesystem::path& file);

/// A model of a run of anigen-train: a run folder, whose newest weights are taken, averaged where there are averages
/// (nn/state_dict.h), or a `.safetensors` file of such a folder.
/// @throws InputError naming the file when there is no such thing
nn::RunModel model_at(const std::filesystem::path& path, const std::string& class_name);

/// Returns the result of `make`; InputErrors without a file then name this one.
template <typename Make>
auto naming(const std::filesystem::path& file, Make make) -> decltype(make()) {
  try {
    return make();
  } catch (const InputError& error) {
    if (!error.file().empty()) throw;
    throw InputError(file.string(), error.place(), error.problem());
  }
}

/// The bones that a learned skinning weighs, and whom their weights move.
struct RigBones {
  torch::Tensor bones;     ///< [K, 6] fp32: head and tail, in the frame of the joints
  std::vector<int> heads;  ///< [K] joints: a bone moves with the joint at its head (io/rigs/anymate.h)
};

/// Bones of joints as Anymate's data have them, ends of bones among them: for every joint but the root one from its
/// parent to itself (reference anymate-baselines.md, 1.5). @param joints [J, 3] @param parents [J], -1 for the root
RigBones bones_between(const torch::Tensor& joints, const std::vector<int>& parents);

/// Bones of any other rig, where all joints move something: one from every joint, as in the data that the models learn
/// from (anymate/dataset.h), to its child, or to the middle of its children. Where there is no child, these
/// data have it end where its weights are; here it goes half of its parent's bone straight on.
RigBones bones_of_rig(const torch::Tensor& joints, const std::vector<int>& parents);

/// Callbacks of a learned rigger for joints; unset where it has no model for it. Positions are in the shape's frame.
struct JointModels {
  std::function<std::vector<Eigen::Vector3d>()> predict;
  std::function<std::vector<int>(const std::vector<Eigen::Vector3d>&)> connect;  ///< [J], -1 for the root
};

/// Joints of one shape and their tree. Joints are predicted, or, without a model for them, those that `given` proposes.
/// Parents are those of the model for connectivity; without one those given with the joints, and of predicted joints
/// the shortest tree through them. Given joints keep their names. @throws InputError as `given` and the models
rigging::ProposedJoints propose_by_models(const io::RiggedShape& shape, const rigging::JointProposer& given,
                                          const JointModels& models);

/// Positions of the shape's frame in that of a model, [J].
template <typename Frame>
std::vector<Eigen::Vector3f> placed_in(const Frame& frame, const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3d& point : points) moved.emplace_back(frame.into(point).template cast<float>());
  return moved;
}

/// A rigger with propose() and bind() as steps of rig_meshes(); what is not wanted stays with the request's method.
template <typename Rigger>
rigging::LearnedSteps learned_steps(const std::shared_ptr<Rigger>& rigger, bool proposes, bool binds) {
  rigging::LearnedSteps steps;
  if (proposes) {
    steps.propose = [rigger](const io::RiggedShape& shape, const rigging::JointProposer& given) {
      return rigger->propose(shape, given);
    };
  }
  if (binds) {
    steps.bind = [rigger](const io::RiggedShape& shape, const Skeleton& skeleton) {
      return rigger->bind(shape, skeleton);
    };
  }
  return steps;
}

}  // namespace anigen::generate
