#pragma once
#include <string>

#include "anigen/asset/asset.h"

namespace anigen {

/// Gives an asset without a rig one joint at the origin, which every vertex follows: what io::write_gltf can write.
void bind_rigidly(Asset& asset, const std::string& joint);

}  // namespace anigen
