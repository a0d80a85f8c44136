#pragma once
#include <memory>
#include <string>
#include <vector>

#include "anigen/prepare/feature_extractor.h"

namespace anigen::features {

/// What `--features` may name: "surface" and the published DINOv2 models.
std::vector<std::string> feature_models();

/// The extractor that the options name (a prepare::FeatureExtractorFactory).
/// @throws InputError for an unknown name (naming the nearest), for a DINOv2 model without weights (saying how to give
///   them), for weights given to `surface`, and for weights that do not fit
std::unique_ptr<prepare::FeatureExtractor> make_feature_extractor(const prepare::FeatureOptions& options);

}  // namespace anigen::features
