#include "anigen/loaders/rignet/rignet_dataset.h"

#include <string>
#include <utility>

#include "anigen/loaders/converted_assets.h"

namespace anigen::loaders {
namespace {

std::string problem_of(const RignetSample& sample, const RignetDatasetOptions& options) {
  const auto joints = static_cast<std::size_t>(sample.rig.joints.size(0));
  const auto bones = static_cast<std::size_t>(sample.rig.bones.size(0));
  if (bones < options.min_bones || bones > options.max_bones) return std::to_string(bones) + " bones";
  if (joints > options.max_joints) return std::to_string(joints) + " joints";
  return "";
}

std::shared_ptr<const RignetDataset> converted_set(const std::vector<AssetId>& assets,
                                                   const RignetDatasetOptions& options, bool held_out) {
  RignetConversion conversion = options.conversion;
  conversion.held_out = held_out;
  auto all = convert_assets<RignetSample>(
      assets, [&](const RiggedItem& item) { return convert_for_rignet(item, conversion); },
      [&](const RignetSample& sample) { return problem_of(sample, options); });
  all.report(options.skip_broken, held_out ? "hold out" : "train on");
  return std::make_shared<const RignetDataset>(std::move(all.samples), all.repeat);
}

}  // namespace

RignetMeshOptions read_rignet_mesh_options(ConfigReader& reader) {
  RignetMeshOptions options;
  options.most_vertices = static_cast<std::size_t>(reader.integer("most_vertices", 2000, 16, 20000));
  options.geodesic_samples = static_cast<std::size_t>(reader.integer("geodesic_samples", 4000, 0, 100000));
  return options;
}

RignetDatasetOptions RignetDatasetOptions::read(ConfigReader& reader) {
  RignetDatasetOptions options;
  options.conversion.mesh = read_rignet_mesh_options(reader);
  options.conversion.points = static_cast<std::size_t>(reader.integer("points", 8192, 1, 1 << 20));
  options.min_bones = static_cast<std::size_t>(reader.integer("min_bones", 1, 1, 4096));
  options.max_bones = static_cast<std::size_t>(reader.integer("max_bones", 64, 1, 4096));
  options.max_joints = static_cast<std::size_t>(reader.integer("max_joints", 96, 1, 4096));
  options.read_common(reader);
  options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", true);
  return options;
}

RignetDataset::RignetDataset(std::vector<RignetSample> samples, const std::vector<std::size_t>& repeat)
    : samples_(std::move(samples)) {
  for (std::size_t i = 0; i < samples_.size(); ++i) visits_.insert(visits_.end(), repeat[i], i);
}

std::unique_ptr<Batch> RignetDataset::load(const std::vector<Draw>& draws) const {
  auto batch = std::make_unique<RignetDraws>();
  for (const Draw& draw : draws) {
    batch->samples.push_back(samples_[visits_[draw.item]]);
    batch->ids.push_back(batch->samples.back().rig.name);
  }
  return batch;
}

RignetDatasets open_rignet(const RignetDatasetOptions& options) {
  const TrainAndEval assets = select(options);
  RignetDatasets sets;
  sets.train = converted_set(assets.train, options, /*held_out=*/false);
  if (!assets.eval.empty()) sets.held_out = converted_set(assets.eval, options, /*held_out=*/true);
  return sets;
}

}  // namespace anigen::loaders
