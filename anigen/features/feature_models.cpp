#include "anigen/features/feature_models.h"

#include <algorithm>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/features/dino_features.h"
#include "anigen/features/surface_features.h"

namespace anigen::features {
namespace {

constexpr const char* kSurface = "surface";

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

std::vector<std::string> feature_models() {
  std::vector<std::string> all = {kSurface};
  for (const std::string& name : models::Dinov2Options::names()) all.push_back(name);
  return all;
}

std::unique_ptr<prepare::FeatureExtractor> make_feature_extractor(const prepare::FeatureOptions& options) {
  const std::vector<std::string> known = feature_models();
  if (std::find(known.begin(), known.end(), options.model) == known.end()) {
    const std::string nearest = nearest_word(options.model, known);
    throw InputError("", "",
                     "there is no feature model '" + options.model + "'; " +
                         (nearest.empty() ? "use one of " + joined(known) : "did you mean '" + nearest + "'?"));
  }
  if (options.model == kSurface) {
    if (!options.weights.empty()) {
      throw InputError(options.weights.string(), "", "feature model 'surface' takes no weights");
    }
    return std::make_unique<SurfaceFeatures>();
  }
  if (options.weights.empty()) {
    throw InputError(
        "", "",
        "feature model '" + options.model + "' needs its published weights: give --feature-weights FILE (" +
            models::Dinov2Options::published_file_stem(options.model) +
            ".pth, or the same tensors as .safetensors), or use feature model 'surface', which needs none");
  }
  return std::make_unique<DinoFeatures>(options.model, options.weights, options.device);
}

}  // namespace anigen::features
