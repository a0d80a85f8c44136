#pragma once
#include <assimp/scene.h>
#include <assimp/Importer.hpp>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/io/gltf/gltf.h"

namespace anigen::io::assimp_import {

/// Assimp's scene of a file: triangles only, every index, pointer and count in it checked. It lives as long as the
/// importer. @throws InputError, NotSupportedError
/// @param frame set to what a COLLADA file says
const aiScene& load(Assimp::Importer& importer, const std::filesystem::path& file, const ImportOptions& options,
                    FileFrame& frame);

/// Edges of the node graph. Node 0 is the scene.
struct SceneGraph {
  std::vector<std::int64_t> nodes;
  std::vector<std::pair<std::int64_t, std::int64_t>> links;  ///< child, parent; those of unknown nodes do not count
};

/// @param what the file's word for nodes, "models" @param place where the links are told
/// @throws InputError when nodes below the scene form a cycle, are nested deeper than 1,024, or are shared so that the
/// tree made of them would have more than `max_nodes` nodes
void check_graph(const SceneGraph& graph, std::size_t max_nodes, const std::string& what, const std::string& place,
                 const std::string& file);

/// Assimp follows elements, records and the scene graph by recursion and without looking for cycles, so a hostile file
/// can overflow its stack or its memory. These look at a file's structure first, without recursion.

/// @return the axis and the unit that the file names
/// @throws InputError when elements are nested deeper than 1,024, or check_graph() refuses the nodes with what their
/// instance_node elements repeat; NotSupportedError for a DOCTYPE, whose entities may grow without bound, and for text
/// in UTF-16
FileFrame scan_collada(std::string_view text, const std::string& file, std::size_t max_nodes = 200'000);

/// Moves blanks in front of an element's numbers behind them: Assimp 5.2 does not skip them everywhere, and then
/// refuses the file or takes the wrong numbers.
void mend_collada(std::string& text);

/// Binary or text, told by the first bytes.
/// @throws InputError naming the byte when records are nested deeper than 64 or leave their parent, or when
/// check_graph() refuses the models, which other objects hang on
void scan_fbx(std::string_view bytes, std::size_t max_nodes, const std::string& file);

}  // namespace anigen::io::assimp_import
