#pragma once
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "anigen/generate/asset_generator.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/generate/picture_input.h"

namespace anigen::generate {

/// A picture as the two flows see it; a size that both see is made once.
class ConditionPictures {
 public:
  /// @throws InputError on a source of normals that the flows do not see, or that lacks its weights
  ConditionPictures(const GenerateRequest& request, const AssetGenerator& generator);

  /// By size: AssetGenerator::structure_size() and latent_size(). Of the first view of an object.
  /// @throws InputError as ImagePreprocessor::run()
  std::map<int, PreprocessedImage> of(const NamedPicture& picture);
  /// Of every view, the first first. @throws InputError also when the flows would see views of different kinds: normals
  /// of some, colours of others
  std::vector<std::map<int, PreprocessedImage>> of_views(const NamedPicture& picture);

 private:
  std::map<int, std::unique_ptr<ImagePreprocessor>> by_size_;
  bool takes_maps_ = false;  // where there are some, which decides what a view shows
};

/// An asset of the images of one object, in memory; of GenerationOptions::voxels_alone its voxels.
struct MadeAsset {
  GeneratedAsset generated;                  ///< as the flows and the decoder gave it
  FinishedAsset finished;                    ///< coloured, finished, in the axes of the request, with its idle clip
  std::vector<io::Image> pictures, normals;  ///< that the flows saw; normals where the first flow sees them
  std::vector<std::string> notices;          ///< what was done, a sentence each
};

/// Makes assets of images with models that are loaded once.
class AssetMaker {
 public:
  /// @param request of models, pictures, finishing, colours, axes and the idle clip; it is copied
  /// @throws InputError when the models are unusable
  explicit AssetMaker(const GenerateRequest& request);

  const AssetGenerator& generator() const { return generator_; }
  /// Shows pictures of the first image as they come: "mask", as large as the image; "normals", where the first flow
  /// sees them; "voxels"; "votes" of a model that makes rigs.
  using Shown = std::function<void(const std::string& name, const io::Image& picture)>;
  /// @param shown null: nobody looks
  /// @throws InputError for an unusable picture; Error when the flows give nothing; Interrupted
  MadeAsset make(const NamedPicture& picture, const std::string& name, const GenerationOptions& sampling,
                 const Shown& shown = nullptr);

 private:
  GenerateRequest request_;
  AssetGenerator generator_;
  ConditionPictures pictures_;
};

}  // namespace anigen::generate
