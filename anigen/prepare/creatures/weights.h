#pragma once
#include "anigen/asset/skin_weights.h"
#include "anigen/prepare/creatures/body.h"
#include "anigen/prepare/creatures/surface.h"

namespace anigen::prepare {

/// Skin weights as an artist would paint them, for a posed body and its surface.
///
/// A vertex belongs to the joint of the primitive it lies on. Around every joint there is a band, across the bisector
/// of the two bones, in which weight passes from the parent to the child by a smooth step; its half width is
/// Body::softness times the limb radius. Bands act only along the tree: a vertex can hear its own joint, ancestors and
/// descendants up to three hops away, never another limb, however close that is in space. Joint::twist_of helpers take
/// over linearly along their bone. A few diffusion steps over the mesh, under the same restriction, even out what is
/// left; small weights are dropped.
/// @return one row per vertex, at most 8 influences each
SkinWeights paint_weights(const Body& body, const Surface& surface);

}  // namespace anigen::prepare
