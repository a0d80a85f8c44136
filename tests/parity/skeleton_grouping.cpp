// From votes to a skeleton: grouping by both strategies, skin features of the grouped joints, repair of parents, hops.
#include <string>
#include <vector>

#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/skeleton_repair.h"
#include "tests/parity/mesh_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

/// Names in a fixture of the arguments of the groupings, each in its own place.
void read_number(const Json& from, const char* name, float& to) {
  if (from.contains(name)) to = static_cast<float>(from.at(name).get<double>());
}

void read_number(const Json& from, const char* name, int& to) {
  if (from.contains(name)) to = from.at(name).get<int>();
}

Tensor optional_input(const Fixture& fixture, const std::string& name) {
  return fixture.has_input(name) ? fixture.input(name) : Tensor();
}

void run_grouping(Fixture& fixture) {
  for (const auto& [name, setup] : fixture.config().at("cases").items()) {
    skeleton_field::SkeletonField field;
    field.joints = fixture.input(name + ".joints");
    field.parents = fixture.input(name + ".parents");
    field.conf_j = optional_input(fixture, name + ".joints_conf");
    field.conf_p = optional_input(fixture, name + ".parents_conf");
    const std::string strategy = setup.at("strategy");
    const Json& arguments = setup.at("kwargs");
    skeleton_field::MeanShiftOptions mean_shift;
    read_number(arguments, "conf_threshold", mean_shift.confidence_threshold);
    read_number(arguments, "threshold", mean_shift.bandwidth);
    read_number(arguments, "cluster_size_threshold", mean_shift.min_cluster_size);
    skeleton_field::ThresholdOptions threshold;
    read_number(arguments, "conf_threshold", threshold.confidence_threshold);
    read_number(arguments, "threshold", threshold.distance);

    const skeleton_field::SkeletonTensors skeleton =
        skeleton_field::group_votes(field, strategy, mean_shift, threshold);
    fixture.check(name + ".joints", skeleton.joints);
    Tensor parents = skeleton.parents;
    if (parents.numel() == 0) {
      // An empty skeleton has as many parents as joints here. The published mean shift gives one parent, 0, to no
      // joint, and the published union-find a second axis.
      parents =
          strategy == "mean_shift" ? torch::cat({parents, torch::zeros({1}, torch::kInt64)}) : parents.reshape({0, 1});
    }
    fixture.check(name + ".parents", parents);
  }
}

void run_skeleton_grouping(Fixture& fixture) {
  const Json& config = fixture.config();
  skeleton_field::MeanShiftOptions mean_shift;
  read_number(config, "ms_conf_threshold", mean_shift.confidence_threshold);
  read_number(config, "ms_threshold", mean_shift.bandwidth);
  read_number(config, "cluster_size_threshold", mean_shift.min_cluster_size);
  skeleton_field::ThresholdOptions threshold;
  read_number(config, "conf_threshold", threshold.confidence_threshold);
  read_number(config, "threshold", threshold.distance);
  for (std::size_t c = 0; c < config.at("cases").size(); ++c) {
    const std::string name = "c" + std::to_string(c) + ".";
    skeleton_field::SkeletonField field;
    field.joints = fixture.input(name + "joints");
    field.parents = fixture.input(name + "parents");
    field.conf_j = fixture.input(name + "conf_j");
    field.conf_p = fixture.input(name + "conf_p");
    field.conf_skin = field.conf_j;  // as with jp_hyper_continuous
    field.positions = fixture.input(name + "positions");
    field.skin_features = fixture.input(name + "skin_feats");

    const skeleton_field::SkeletonTensors by_threshold =
        skeleton_field::group_votes(field, "threshold", mean_shift, threshold);
    fixture.check(name + "thr_joints", by_threshold.joints);
    fixture.check(name + "thr_parents", by_threshold.parents);
    const skeleton_field::SkeletonTensors by_shift =
        skeleton_field::group_votes(field, "mean_shift", mean_shift, threshold);
    fixture.check(name + "ms_joints", by_shift.joints);
    fixture.check(name + "ms_parents", by_shift.parents);
    const skeleton_field::JointSkinFeatures features = skeleton_field::joint_skin_features(field, by_shift.joints);
    fixture.check(name + "feat_joints", features.features);
    fixture.check(name + "var_loss", features.variance);
  }
}

void run_skeleton_repair(Fixture& fixture) {
  for (std::size_t c = 0; c < fixture.config().at("cases").size(); ++c) {
    const std::string name = "c" + std::to_string(c) + ".";
    const std::vector<Eigen::Vector3f> joints = float_points(fixture.input(name + "joints"));
    const std::vector<int> raw = ints(fixture.input(name + "parents"));
    const std::vector<int> repaired = skeleton_field::repair_parents_as_published(joints, raw);
    fixture.check(name + "parents", torch::tensor(repaired, torch::kInt32));
    fixture.check(name + "parents_nojoints",
                  torch::tensor(skeleton_field::repair_parents_as_published({}, raw), torch::kInt32));
    const auto count = static_cast<std::int64_t>(repaired.size());
    const Tensor hops = torch::empty({count, count}, torch::kInt32);
    std::int32_t* next = hops.data_ptr<std::int32_t>();
    for (const std::vector<int>& row : skeleton_field::hop_distances(repaired)) {
      for (const int distance : row) *next++ = distance;
    }
    fixture.check(name + "hops", hops);
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(grouping, anigen::test::run_grouping)
ANIGEN_PARITY(ops_data_skeleton_grouping, anigen::test::run_skeleton_grouping)
ANIGEN_PARITY(ops_data_skeleton_repair, anigen::test::run_skeleton_repair)
