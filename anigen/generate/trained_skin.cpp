#include "anigen/generate/trained_skin.h"

#include <algorithm>
#include <functional>
#include <map>
#include <sstream>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/data/skin_correction_dataset.h"
#include "anigen/data/view_files.h"
#include "anigen/nn/state_dict.h"
#include "anigen/rigging/bone_heat.h"
#include "anigen/skin_correction/weights.h"

namespace anigen::generate {

using skin_correction::SkinCorrection;

struct TrainedSkin::Loaded {
  SkinCorrection network = nullptr;
  std::filesystem::path file;
  std::string fold;
  std::vector<std::filesystem::path> roots;
};

TrainedSkin::TrainedSkin(const std::filesystem::path& run) : loaded_(std::make_unique<Loaded>()) {
  const nn::RunModel found = nn::find_run_model(run, skin_correction::kSkinCorrectionClass);
  loaded_->network = nn::load_trained<SkinCorrection>(found, torch::kCPU);
  loaded_->file = found.checkpoint;
  const Json::json_pointer fold("/dataset/args/fold");
  if (found.run.contains(fold) && found.run[fold].is_string()) loaded_->fold = found.run[fold].get<std::string>();
  const Json::json_pointer data("/dataset/args/data_dir");
  if (!found.run.contains(data) || !found.run[data].is_string()) return;
  std::istringstream words(found.run[data].get<std::string>());
  for (std::string root; std::getline(words, root, ',');) loaded_->roots.emplace_back(root);
}

TrainedSkin::~TrainedSkin() = default;

SkinWeights TrainedSkin::bind(const Mesh& mesh, const Skeleton& skeleton, std::size_t most_influences) {
  return weights(*features(mesh, skeleton), most_influences, smoothing());
}

std::unique_ptr<rigging::SkinFeatures> TrainedSkin::features(const Mesh& mesh, const Skeleton& skeleton) const {
  return std::make_unique<rigging::SkinFeatures>(mesh, skeleton, loaded_->network->options().features());
}

SkinWeights TrainedSkin::weights(const rigging::SkinFeatures& features, std::size_t most_influences, double smoothing) {
  try {
    return skin_correction::corrected_weights(loaded_->network, features, most_influences, smoothing);
  } catch (const InputError& error) {
    throw InputError(loaded_->file.string(), error.place(), error.problem());
  }
}

const std::string& TrainedSkin::fold() const { return loaded_->fold; }

std::string TrainedSkin::trained_signature(const std::string& id) const {
  for (const std::filesystem::path& root : loaded_->roots) {
    const data::AssetId asset{root, id};
    std::error_code error;
    if (std::filesystem::exists(data::rig_path(asset), error)) return data::skeleton_signature_of(asset);
  }
  return "";
}

double TrainedSkin::smoothing() const { return loaded_->network->options().smoothing; }

rigging::LearnedSteps TrainedSkin::steps(const std::shared_ptr<TrainedSkin>& skin, std::size_t most_influences) {
  rigging::LearnedSteps steps;
  steps.bind = [skin, most_influences](const io::RiggedShape& shape, const Skeleton& skeleton) {
    return skin->bind(shape.mesh, skeleton, most_influences);
  };
  return steps;
}

namespace {

constexpr std::size_t kFourInfluences = 4;
constexpr double kHalfSmoothed = 0.5;

/// A ground truth as binding wants it: parents before children.
struct BoundTruth {
  Mesh mesh;
  Skeleton skeleton;
  std::vector<int> order;  // joint of the truth of each joint of the skeleton
};

BoundTruth bound_truth(const eval::GroundTruth& truth) {
  BoundTruth bound;
  bound.mesh.vertices = truth.vertices;
  bound.mesh.faces = truth.faces;
  bound.order = parents_first({in_double(truth.joints), truth.parents});
  std::vector<int> place(bound.order.size()), parents;
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t i = 0; i < bound.order.size(); ++i) place[at(bound.order[i])] = static_cast<int>(i);
  for (const int joint : bound.order) {
    const int parent = truth.parents[at(joint)];
    parents.push_back(parent < 0 ? -1 : place[at(parent)]);
    positions.push_back(truth.joints[at(joint)].cast<double>());
  }
  bound.skeleton = skeleton_from_joints(positions, parents);
  return bound;
}

std::vector<float> dense_weights(const SkinWeights& skin, const std::vector<int>& order) {
  std::vector<float> dense(skin.rows() * order.size(), 0.0F);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    for (std::size_t i = 0; i < skin.row_size(v); ++i)
      dense[v * order.size() + at(order[at(skin.row(v)[i].joint)])] = skin.row(v)[i].weight;
  }
  return dense;
}

/// The runs, and the asset that was looked at last with its features: methods come one after the other for an asset.
class CorrectionRuns {
 public:
  explicit CorrectionRuns(const std::vector<std::filesystem::path>& runs) {
    if (runs.empty()) throw InputError("", "--skin-run", "name a run of AniGenSkinCorrectionTrainer");
    for (const std::filesystem::path& run : runs) {
      runs_.push_back(std::make_unique<TrainedSkin>(run));
      if (!runs_.back()->fold().empty()) {
        add_fold(run);
      } else if (runs.size() > 1) {
        throw InputError(run.string(), "/dataset/args/fold",
                         "of several runs each must have held out a fold of its own");
      }
    }
  }

  using Binder = std::function<SkinWeights(TrainedSkin&, const rigging::SkinFeatures&, const BoundTruth&)>;
  std::vector<float> predict(const io::DatasetItem& item, const eval::GroundTruth& truth, const Binder& binder) {
    if (item.id != id_ || !features_) {
      features_.reset();
      bound_ = bound_truth(truth);
      run_ = &run_of(item, truth);
      features_ = run_->features(bound_.mesh, bound_.skeleton);
      id_ = item.id;
    }
    return dense_weights(binder(*run_, *features_, bound_), bound_.order);
  }

 private:
  void add_fold(const std::filesystem::path& run) {
    const auto fold = data::SkeletonFold::parse(runs_.back()->fold(), run.string(), "/dataset/args/fold");
    if (count_ != 0 && fold.count != count_)
      throw InputError(run.string(), "/dataset/args/fold", "is of another number of folds than that of the other runs");
    count_ = fold.count;
    if (!of_fold_.emplace(fold.index, runs_.size() - 1).second)
      throw InputError(run.string(), "/dataset/args/fold", "is also that of another run");
  }
  TrainedSkin& run_of(const io::DatasetItem& item, const eval::GroundTruth& truth) const {
    const bool is_creature = item.source.rfind("procedural:", 0) == 0;
    if (count_ == 0 || is_creature) return *runs_.front();
    // The dataset of the evaluation may have been prepared otherwise, with joints merged or left: the training's
    // counts.
    std::string signature = runs_.front()->trained_signature(item.id);
    if (signature.empty()) signature = tree_signature(truth.parents);
    for (const auto& [index, run] : of_fold_) {
      if (data::SkeletonFold{index, count_}.holds(signature)) return *runs_[run];
    }
    throw InputError(item.id, "", "none of the runs has held its skeleton out");
  }

  std::vector<std::unique_ptr<TrainedSkin>> runs_;
  std::map<std::size_t, std::size_t> of_fold_;  // fold → run
  std::size_t count_ = 0;                       // folds; 0: none
  std::string id_;
  BoundTruth bound_;
  TrainedSkin* run_ = nullptr;
  std::unique_ptr<rigging::SkinFeatures> features_;
};

SkinWeights classical(const rigging::SkinFeatures& features, const SkinWeights& of_places) {
  SkinWeights skin;
  for (const std::int32_t place : features.place_of_vertex()) skin.append_copy(of_places, at(place));
  return limit_influences(skin, kFourInfluences);
}

}  // namespace

std::vector<eval::SkinMethod> skin_correction_methods(const std::vector<std::filesystem::path>& runs, Json& settings) {
  const auto all = std::make_shared<CorrectionRuns>(runs);
  settings["skin_runs"] = Json::array();
  for (const std::filesystem::path& run : runs) settings["skin_runs"].push_back(run.string());
  const auto method = [&all](const char* key, const char* label, CorrectionRuns::Binder binder) {
    eval::SkinMethod made;
    made.key = key;
    made.label = label;
    made.parallel = false;
    made.predict = [all, binder = std::move(binder)](const io::DatasetItem& item, const eval::GroundTruth& truth) {
      return all->predict(item, truth, binder);
    };
    return made;
  };
  const auto corrected = [](double smoothing) {
    return [smoothing](TrainedSkin& skin, const rigging::SkinFeatures& features, const BoundTruth&) {
      return skin.weights(features, kFourInfluences, smoothing);
    };
  };
  return {method("learned", "learned correction", corrected(0.0)),
          method("learned_smoothed", "learned correction, smoothed", corrected(kHalfSmoothed)),
          method("heat", "bone heat",
                 [](TrainedSkin&, const rigging::SkinFeatures& features, const BoundTruth&) {
                   return classical(features, features.heat());
                 }),
          method("geovoxel", "geodesic voxels",
                 [](TrainedSkin&, const rigging::SkinFeatures& features, const BoundTruth&) {
                   return classical(features, features.geodesic());
                 }),
          method("fitted_heat", "bone heat as auto binds",
                 [](TrainedSkin&, const rigging::SkinFeatures&, const BoundTruth& truth) {
                   return rigging::bind_by_heat(truth.mesh, truth.skeleton, rigging::fitted_heat(kFourInfluences));
                 })};
}

}  // namespace anigen::generate
