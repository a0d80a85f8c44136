#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/batch_source.h"
#include "anigen/loaders/rignet/rignet_samples.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// Samples for RigNet, to be put together by whoever trains on them.
struct RignetDraws : Batch {
  std::vector<RignetSample> samples;
};

/// `dataset.args` of the class "Rignet" (ours): prepared data sets (source_options.h), their meshes as graphs.
struct RignetDatasetOptions : SourceOptions {
  RignetConversion conversion;  ///< most_vertices, geodesic_samples, points; the trainer sets the task
  std::size_t min_bones = 1, max_bones = 64, max_joints = 96;  ///< samples outside are left out, as by Anymate's

  static RignetDatasetOptions read(ConfigReader& reader);
};

/// most_vertices (2000) and geodesic_samples (4000): what rigging with a trained model also has to know.
RignetMeshOptions read_rignet_mesh_options(ConfigReader& reader);

/// Samples in memory.
class RignetDataset : public BatchSource {
 public:
  /// @param repeat how often an epoch visits each sample
  RignetDataset(std::vector<RignetSample> samples, const std::vector<std::size_t>& repeat);

  std::size_t size() const override { return visits_.size(); }
  std::size_t samples() const { return samples_.size(); }
  const RignetSample& sample(std::size_t index) const { return samples_[index]; }
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const override;

 private:
  std::vector<RignetSample> samples_;
  std::vector<std::size_t> visits_;
};

struct RignetDatasets {
  std::shared_ptr<const RignetDataset> train, held_out;  ///< the latter null when nothing is held out
};

/// Reads and converts everything; what cannot be used is left out, counted and, with debug messages, named.
/// @throws InputError when nothing is left, and for files that cannot be read unless skip_broken
RignetDatasets open_rignet(const RignetDatasetOptions& options);

}  // namespace anigen::loaders
