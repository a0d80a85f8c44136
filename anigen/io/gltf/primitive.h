#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io::gltf_import {

struct TriangleList {
  std::vector<Triangle> faces;
  std::size_t degenerate = 0;  ///< triangles that named a vertex twice and were left out
  std::size_t left_over = 0;   ///< indices at the end that made no triangle
};

/// Triangles of a primitive (glTF 2.0, section 3.7.2.1).
/// @param mode 4 triangles, 5 strip, 6 fan @param indices vertex numbers, below 2^31
TriangleList triangulate(int mode, const std::vector<std::uint32_t>& indices);

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

/// Appends one row per vertex of a skinned primitive, repaired where the file's weights are wrong, and notes every
/// kind of repair with its count: "negative_weights" (taken as 0), "unnormalised_weights" (divided by their sum),
/// "nan_weights" and "zero_weights" (bound like the nearest vertex of the primitive with proper weights, or to the
/// joint nearest in the bind pose when it has none).
/// @param pointer of the primitive, for errors @param joint_positions of the rig in the bind pose, [J]
/// @throws InputError when a joint index with weight lies outside the skin
void append_weights(const VertexBlock& block, const SkinBinding& binding,
                    const std::vector<Eigen::Vector3d>& joint_positions, const std::string& file,
                    const std::string& pointer, SkinWeights& weights, Notes& notes);

}  // namespace anigen::io::gltf_import
