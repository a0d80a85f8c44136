#pragma once
#include "anigen/asset/asset.h"
#include "anigen/io/image.h"

namespace anigen::eval {

/// Pictures beside each other. Of a skinned asset: in colour, its skin weights, its skeleton over the weights; of a
/// mesh without a rig: in colour, its normals; of a mesh beside a skeleton that does not move it: in colour, with the
/// skeleton; of a skeleton without a mesh: as a solid, at rest and in the middle of its first animation.
/// @param size of one picture in pixels @throws InputError for points without faces
io::Image asset_picture(const Asset& asset, int size = 480);

}  // namespace anigen::eval
