#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/io/ndarray.h"

namespace anigen::prepare {

/// What the features of one asset are computed from.
struct FeatureRequest {
  const Asset& asset;                          ///< normalised into [-0.5, 0.5]³, Z up, in its bind pose
  const std::vector<geometry::Voxel>& voxels;  ///< [N] surface voxels, sorted
  int resolution = 64;                         ///< of the voxel grid
  std::filesystem::path views;                 ///< renders/<id>; empty when the extractor needs no views
};

/// Gives every surface voxel a vector: features/<name>/<id>.npz of the published layout (reference
/// training-and-data.md, 1.1). Made in the worker that uses it, never in the parent of a run, since an extractor may
/// start a tensor library. extract() is called from one thread at a time.
class FeatureExtractor {
 public:
  virtual ~FeatureExtractor() = default;

  /// The folder under features/ and the column feature_<name> of metadata.csv.
  virtual std::string name() const = 0;
  /// What the values depend on besides the asset and its views: weights by content, number of views used, version
  /// of the method. Outputs made under another fingerprint are made again.
  virtual std::string fingerprint() const { return name(); }
  virtual int channels() const = 0;
  /// Whether FeatureRequest::views must hold transforms.json and its pictures.
  virtual bool needs_views() const = 0;
  /// @return float16 [N, channels()], rows in the order of request.voxels
  /// @throws InputError naming a view that cannot be read
  virtual io::NdArray extract(const FeatureRequest& request) const = 0;
};

/// Which extractor, as the command line names it.
struct FeatureOptions {
  std::string model;              ///< "surface", "dinov2_vits14_reg", "dinov2_vitl14_reg", …; empty for none
  std::filesystem::path weights;  ///< .pth or .safetensors of a learned model
  std::string device = "cpu";
  bool operator==(const FeatureOptions& other) const {
    return model == other.model && weights == other.weights && device == other.device;
  }
};

/// Makes the extractor that the options name. @throws InputError for an unknown model or missing weights,
/// NotSupportedError for a model that this build cannot run
using FeatureExtractorFactory = std::function<std::unique_ptr<FeatureExtractor>(const FeatureOptions&)>;

}  // namespace anigen::prepare
