#pragma once
#include <cstddef>

#include "anigen/asset/skin_weights.h"
#include "anigen/rigging/skin_features.h"
#include "anigen/skin_correction/network.h"

namespace anigen::skin_correction {

/// Candidates of some places as a network takes them.
struct PairTensors {
  Tensor pairs;    ///< [N, K, rigging::kSkinPairFeatures] fp32
  Tensor assets;   ///< [N, rigging::kSkinAssetFeatures] fp32, equal rows
  Tensor present;  ///< [N, K] bool
};

PairTensors pair_tensors(const rigging::SkinFeatures& features, const rigging::SkinPairs& pairs);

/// Skin weights of all vertices by a trained network, on the CPU, a block of places at a time, which does not change
/// them. Weights below 1e-4 are dropped.
/// @param features made with network->options().features() @param most_influences joints per vertex; 0: any number
/// @param smoothing share of the mean over the neighbours along edges, so within a shell, in each vertex' weights
/// @return [V] @throws InputError for features of another number of candidates, or weights that are not finite
SkinWeights corrected_weights(SkinCorrection& network, const rigging::SkinFeatures& features,
                              std::size_t most_influences, double smoothing = 0.0);

}  // namespace anigen::skin_correction
