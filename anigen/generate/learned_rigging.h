#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/skin_weights.h"
#include "anigen/core/error.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::generate {

/// Folders of the models of a learned rigger; an empty path: no such model.
struct LearnedModelFiles {
  std::filesystem::path joints, connectivity, skin;
};

/// A model of a run of anigen-train: a run folder, whose newest weights are taken, averaged where there are averages
/// (nn/state_dict.h), or a `.safetensors` file of such a folder.
/// @throws InputError naming the file when there is no such thing
nn::RunModel model_at(const std::filesystem::path& path, const std::string& class_name);

/// The bones that a learned skinning weighs, and whom their weights move.
struct RigBones {
  torch::Tensor bones;     ///< [K, 6] fp32: head and tail, in the frame of the joints
  std::vector<int> heads;  ///< [K] joints: a bone moves with the joint at its head (io/rigs/anymate.h)
};

/// Bones of joints as Anymate's data have them, ends of bones among them: for every joint but the root one from its
/// parent to itself (docs/reference/anymate.md, 1.5). @param joints [J, 3] @param parents [J], -1 for the root
RigBones bones_between(const torch::Tensor& joints, const std::vector<int>& parents);

/// Bones of any other rig, where all joints move something: one from every joint, as in the data that the models learn
/// from (anymate/dataset.h), to its child, or to the middle of its children. Where there is no child, these
/// data have it end where its weights are; here it goes half of its parent's bone straight on.
RigBones bones_of_rig(const torch::Tensor& joints, const std::vector<int>& parents);

/// Models of a learned rigger by what they are to do; any may be missing.
/// @tparam Trained with `file`, the file of the weights, for messages
template <typename Trained>
struct RiggerModels {
  std::optional<Trained> joints, connectivity, skin;
};

/// @param word_of std::string(const Trained&): joints, connectivity or skinning
/// @throws InputError naming the file of a model that is for another task than its place
template <typename Trained, typename Word>
void require_tasks(const RiggerModels<Trained>& models, const Word& word_of) {
  const auto check = [&](const std::optional<Trained>& trained, const char* wanted) {
    if (!trained || word_of(*trained) == wanted) return;
    throw InputError(trained->file.string(), "", "this model is for " + word_of(*trained) + ", not for " + wanted);
  };
  check(models.joints, "joints");
  check(models.connectivity, "connectivity");
  check(models.skin, "skinning");
}

/// @param load Trained(path) @throws InputError as `load` and require_tasks()
template <typename Trained, typename Load, typename Word>
RiggerModels<Trained> load_rigger_models(const LearnedModelFiles& files, const Load& load, const Word& word_of) {
  RiggerModels<Trained> models;
  if (!files.joints.empty()) models.joints = load(files.joints);
  if (!files.connectivity.empty()) models.connectivity = load(files.connectivity);
  if (!files.skin.empty()) models.skin = load(files.skin);
  require_tasks(models, word_of);
  return models;
}

/// @throws InputError naming the file of a model whose numbers are not finite
void require_finite(const torch::Tensor& numbers, const std::filesystem::path& model);

/// A rigger of meshes with trained models, any of them missing. Each mesh is looked at by itself: what it is given
/// depends on the seed, not on the meshes before it. Positions and results are in the shape's frame.
class LearnedRigger {
 public:
  virtual ~LearnedRigger() = default;

  /// Joints and their tree. Joints are predicted, or, without a model for them, those that `given` proposes. Parents
  /// are those of the model for connectivity; without one those given with the joints, and of predicted joints the
  /// shortest tree through them. Given joints keep their names.
  /// @throws InputError without a surface, as `given` and the models
  rigging::ProposedJoints propose(const io::RiggedShape& shape, const rigging::JointProposer& given);

  /// Weights by the model for skinning, which must be there, for the joint at the head of each bone. Predicted joints
  /// have the bones between them (bones_between()), any others bones of their own (bones_of_rig()). A predicted
  /// skeleton of one joint gets all weights.
  /// @return one row per vertex of the shape @throws InputError without a surface, or for weights that are not finite
  SkinWeights bind(const io::RiggedShape& shape, const Skeleton& skeleton);

  /// The steps of rig_meshes() that the models take over; what they lack stays with the request's method.
  static rigging::LearnedSteps steps(const std::shared_ptr<LearnedRigger>& rigger);

 protected:
  /// @param most_influences joints per vertex; 0: any number
  template <typename Trained>
  LearnedRigger(const RiggerModels<Trained>& models, std::size_t most_influences)
      : predicts_(models.joints),
        connects_(models.connectivity),
        binds_(models.skin),
        most_influences_(most_influences) {}

  RigBones bones_of(const torch::Tensor& joints, const std::vector<int>& parents) const {
    return predicts_ ? bones_between(joints, parents) : bones_of_rig(joints, parents);
  }

 private:
  virtual std::vector<Eigen::Vector3d> predicted(const io::RiggedShape& shape) = 0;
  /// @return [J], -1 for the root
  virtual std::vector<int> parents_of(const io::RiggedShape& shape, const std::vector<Eigen::Vector3d>& joints) = 0;
  /// Rows of any number of joints.
  virtual SkinWeights weights_of(const io::RiggedShape& shape, const Skeleton& skeleton) = 0;

  bool predicts_, connects_, binds_;
  std::size_t most_influences_;
};

/// Positions of the shape's frame in that of a model, [J, 3] fp32.
template <typename Frame>
torch::Tensor placed_in(const Frame& frame, const std::vector<Eigen::Vector3d>& points) {
  torch::Tensor moved = torch::empty({static_cast<std::int64_t>(points.size()), 3});
  float* out = moved.data_ptr<float>();
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3f place = frame.into(point).template cast<float>();
    out = std::copy_n(place.data(), 3, out);
  }
  return moved;
}

}  // namespace anigen::generate
