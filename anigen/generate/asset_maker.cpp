#include "anigen/generate/asset_maker.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/picture_colors.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/motions/built_in.h"
#include "anigen/render/picture.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/vision/dsine.h"

namespace anigen::generate {

namespace {

constexpr int kShownSide = 512;  // pixels of the pictures of voxels and votes

// Votes for joints, coloured by confidence.
io::Image votes_picture(const skeleton_field::SkeletonField& votes) {
  VotesCloudOptions drawn;
  drawn.radius = 0.005F;
  render::PictureOptions options;
  options.width = options.height = kShownSide;
  options.background.reset();
  options.ambient_occlusion = options.shadows = false;
  return render::render(votes_asset(votes, drawn), options);
}

// A skeleton that no idle clip fits gets none, which is said.
void add_idle_clip(Asset& asset, std::vector<std::string>& notices) {
  try {
    asset.animations.push_back(motions::idle_clip(asset));
  } catch (const InputError& problem) {
    notices.push_back(std::string("no idle clip: ") + problem.what());
  }
}

/// The views of an object as the flows see them.
struct SeenViews {
  std::vector<torch::Tensor> first, second;  ///< [1, 3, S, S] each, by the two flows
  std::vector<io::Image> pictures, normals;  ///< the same: colours; normals where the first flow sees them
  std::vector<io::Image> parts;              ///< crops for colours
  ObjectMask mask;                           ///< of the first one
  std::vector<std::string> notices;
};

SeenViews see(const AssetGenerator& generator, ConditionPictures& pictures, const NamedPicture& picture) {
  std::vector<std::map<int, PreprocessedImage>> views = pictures.of_views(picture);
  SeenViews seen;
  for (std::size_t view = 0; view < views.size(); ++view) {
    const PreprocessedImage& first = views[view].at(generator.structure_size());
    const PreprocessedImage& second = views[view].at(generator.latent_size());
    const bool normals = generator.structure_sees_normals();
    seen.first.push_back(normals ? first.normals_tensor : first.picture_tensor);
    seen.second.push_back(second.picture_tensor);
    seen.pictures.push_back(second.picture);
    if (normals) seen.normals.push_back(first.normals);
    seen.parts.push_back(second.part);
    if (view == 0) seen.mask = second.mask;
    const std::string whose = views.size() > 1 ? "view " + std::to_string(view + 1) + ": " : "";
    for (const std::string& notice : first.notices) seen.notices.push_back(whose + notice);
  }
  return seen;
}

}  // namespace

ConditionPictures::ConditionPictures(const GenerateRequest& request, const AssetGenerator& generator) {
  std::shared_ptr<vision::NormalEstimator> estimator;
  const NormalSource normals = request.pictures.normals;
  if (!generator.structure_sees_normals() && normals != NormalSource::kAuto && normals != NormalSource::kColors)
    throw InputError("", "--normals", "the first flow sees colours, as trained or by --condition color: leave it out");
  if (generator.structure_sees_normals() && request.pictures.normals == NormalSource::kEstimator) {
    if (request.estimator_weights.empty()) throw InputError("", "--normal-weights", "the estimator needs its weights");
    estimator =
        std::make_shared<vision::DsineNormals>(request.estimator_weights, nn::parse_device(request.models.device));
  }
  for (const int size : {generator.structure_size(), generator.latent_size()}) {
    if (by_size_.count(size) > 0) continue;
    PreprocessingOptions options = request.pictures;
    options.size = size;
    if (!generator.structure_sees_normals()) options.normals = NormalSource::kColors;
    takes_maps_ = options.normals == NormalSource::kAuto;
    by_size_[size] = std::make_unique<ImagePreprocessor>(options, estimator);
  }
}

std::map<int, PreprocessedImage> ConditionPictures::of(const NamedPicture& picture) {
  std::map<int, PreprocessedImage> seen;
  for (auto& [size, preprocessor] : by_size_) seen[size] = preprocessor->run(picture);
  return seen;
}

std::vector<std::map<int, PreprocessedImage>> ConditionPictures::of_views(const NamedPicture& picture) {
  std::vector<std::map<int, PreprocessedImage>> seen;
  for (const NamedPicture& view : picture.others) {
    if (!takes_maps_ || view.normal_map.empty() == picture.normal_map.empty()) continue;
    const NamedPicture& with = view.normal_map.empty() ? picture : view;
    const NamedPicture& without = view.normal_map.empty() ? view : picture;
    throw InputError(without.file.string(), "views",
                     "comes without a map of normals, and " + with.file.string() +
                         ", of the same object, with one: views must be of one kind; --normals color takes no map");
  }
  seen.push_back(of(picture));
  for (const NamedPicture& view : picture.others) seen.push_back(of(view));
  return seen;
}

AssetMaker::AssetMaker(const GenerateRequest& request)
    : request_(request), generator_(request.models), pictures_(request_, generator_) {}

MadeAsset AssetMaker::make(const NamedPicture& picture, const std::string& name, const GenerationOptions& sampling,
                           const Shown& shown) {
  MadeAsset result;
  SeenViews seen = see(generator_, pictures_, picture);
  throw_if_interrupted();
  GenerationOptions options = sampling;
  if (shown) {
    shown("mask", picture_of(seen.mask));
    if (!seen.normals.empty()) shown("normals", seen.normals.front());
    options.voxels_found = [&](const sparse_structure::VoxelPair& voxels) {
      shown("voxels", sparse_structure::voxel_picture(voxels, kShownSide));
      if (sampling.voxels_found) sampling.voxels_found(voxels);
    };
  }
  result.generated = generator_.generate(torch::cat(seen.first), torch::cat(seen.second), name, options);
  throw_if_interrupted();
  GeneratedAsset& made = result.generated;
  result.notices = std::move(seen.notices);
  result.pictures = std::move(seen.pictures);
  result.normals = std::move(seen.normals);
  if (sampling.voxels_alone) return result;
  if (shown && made.decoded.votes.joints.defined()) shown("votes", votes_picture(made.decoded.votes));
  if (request_.picture_colors && made.cameras) {
    const PaintedVertices painted = paint_from_pictures(made.decoded.asset, seen.parts, *made.cameras);
    result.notices.push_back("colours from the picture for " + std::to_string(painted.seen) +
                             " vertices, mirrored for " + std::to_string(painted.mirrored) + ", decoded for " +
                             std::to_string(painted.decoded));
  }
  result.finished =
      finish_asset(made.decoded.asset, finishing_of_flow(request_.finishing, request_.models.latent_flow));
  Asset& asset = result.finished.asset;
  if (request_.published_axes) asset.skeleton = io::unrotated_in_file(asset.skeleton, io::ExportAxes::kPublished);
  if (request_.idle) add_idle_clip(asset, result.notices);
  result.notices.insert(result.notices.end(), result.finished.notices.begin(), result.finished.notices.end());
  return result;
}

}  // namespace anigen::generate
