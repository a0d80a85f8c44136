#pragma once
#include "anigen/asset/asset.h"
#include "anigen/io/image.h"

namespace anigen::eval {

/// Three pictures beside each other: the asset in colour, its skin weights, its skeleton over the weights.
/// @param size of one picture in pixels
io::Image asset_picture(const Asset& asset, int size = 480);

}  // namespace anigen::eval
