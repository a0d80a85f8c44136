#pragma once
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// Writes the animations, keys and interpolation kept; the root's channels are turned into the file's axes (cubic
/// tangents too: a rotation is linear in them). Keys whose times are equal in single precision are merged; of
/// several channels for one property the last is written, which is the one that sample() obeys; channels without
/// keys are left out.
/// @param file only for the message @throws InputError on a rotation of length zero or a number beyond float
void write_animations(GltfDocument& document, const Asset& asset, ExportAxes axes, const std::string& file);

}  // namespace anigen::io
