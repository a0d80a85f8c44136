#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"
#include "anigen/io/gltf/import_triangles.h"

namespace anigen::io::gltf_import {

/// One JOINTS_n / WEIGHTS_n pair, [vertices, 4] each.
struct InfluenceSet {
  std::vector<std::uint32_t> joints;  ///< entries of the skin, not checked yet
  std::vector<float> weights;
};

/// The vertices of a primitive in its mesh's own space.
struct VertexBlock {
  std::size_t count = 0;
  std::vector<float> positions;  ///< [count, 3], finite
  std::vector<float> normals;    ///< [count, 3] or empty; as in the file
  std::vector<float> uvs;        ///< [count, 2] or empty; finite, KHR_texture_transform applied
  std::vector<float> colors;     ///< [count, 4] or empty; in [0, 1]
  std::vector<InfluenceSet> influences;
  float weight_rounding = 0.0f;  ///< how far a sum of correct weights may be from 1 because of their storage
};

struct PrimitiveData {
  VertexBlock vertices;
  std::vector<std::uint32_t> indices;  ///< checked against vertices.count; 0, 1, 2, … when the file has none
};

/// Reads everything a triangle primitive keeps. @param texture which texture coordinates, and how to move them
/// @param max_vertices, max_faces what the importer still accepts @throws InputError
PrimitiveData read_primitive(const Document& document, const Primitive& primitive, const TextureUse& texture,
                             std::size_t max_vertices, std::size_t max_faces, Notes& notes);

/// Only the indices of a primitive without Draco data, checked against `vertices`.
std::vector<std::uint32_t> read_indices(const Document& document, const Primitive& primitive, std::size_t vertices,
                                        std::size_t max_faces);

}  // namespace anigen::io::gltf_import
