#include "anigen/train/anymate_scores.h"

#include "anigen/fields/tensor_points.h"
#include "anigen/models/anymate/connectivity.h"
#include "anigen/models/anymate/predicted_joints.h"
#include "anigen/models/anymate/skinning.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

using torch::Tensor;
namespace anymate = models::anymate;

}  // namespace

void AnymateScores::add(const anymate::AnymateSample& sample, std::uint64_t index) {
  const torch::NoGradGuard no_grad;
  const anymate::AnymateBatch batch = anymate::collate({sample}, {sample.joints.size(0), sample.bones.size(0)});
  const Tensor latents = model_.encode(batch.points_cloud.to(device_));
  switch (anymate::task_of(model_.options().decoder)) {
    case anymate::Task::kConnectivity:
      return add_connectivity(batch, latents);
    case anymate::Task::kSkinning:
      return add_skinning(batch, latents);
    default:
      return add_joints(sample, latents, index);
  }
}

void AnymateScores::add_joints(const anymate::AnymateSample& sample, const Tensor& latents, std::uint64_t index) {
  anymate::JointPrediction options;
  options.train_steps = train_steps_;
  options.noise = torch::randn({1, joints_, 3}, nn::numbered_generator(0, "anymate held-out noise", index)).to(device_);
  options.cells = sample.vox;
  const Tensor predicted = anymate::predicted_joints(model_, latents, options);
  scores_.add_joints(sample.name, fields::points_of<double>(predicted, "predicted"),
                     fields::points_of<double>(sample.joints, "joints"));
}

void AnymateScores::add_connectivity(const anymate::AnymateBatch& batch, const Tensor& latents) {
  const Tensor logits = model_.decoder<anymate::ConnectivityImpl>().forward(latents, batch.joints.to(device_),
                                                                            batch.joints_mask.to(device_));
  const eval::SkinMatrix chances = matrix_of(logits[0].softmax(-1));
  scores_.add_connectivity(batch.names.front(), chances, chances, matrix_of(batch.conns[0]),
                           fields::points_of<double>(batch.joints[0], "joints"));
}

void AnymateScores::add_skinning(const anymate::AnymateBatch& batch, const Tensor& latents) {
  if (!batch.skins.defined()) throw InputError("", batch.names.front() + "/skins_index", "the sample has no weights");
  anymate::SkinningInput input;
  input.latents = latents;
  input.points = batch.points_cloud.to(device_);
  input.bones = batch.bones.to(device_);
  input.mask = batch.bones_mask.to(device_);
  const Tensor predicted = model_.decoder<anymate::SkinningImpl>().forward(input)[0].softmax(-1);
  scores_.add_skinning(batch.names.front(), predicted, batch.skins[0], batch.points_cloud[0].narrow(1, 0, 3),
                       batch.bones[0]);
}

}  // namespace anigen::train
