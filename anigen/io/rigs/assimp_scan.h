#pragma once
#include <cstddef>
#include <string>
#include <string_view>

namespace anigen::io::assimp_import {

/// Assimp follows elements, records and the scene graph by recursion and without looking for cycles, so a hostile file
/// can overflow its stack or its memory. These look at a file's structure first, without recursion.

/// @throws InputError when elements are nested deeper than 1,024, NotSupportedError for instance_node, whose targets
/// may contain themselves
void scan_collada(std::string_view text, const std::string& file);

/// Binary or text, told by the first bytes.
/// @throws InputError naming the byte when records are nested deeper than 64 or leave their parent, or when models
/// (which other objects hang on) form a cycle, are nested deeper than 1,024, or are shared so that the tree made of
/// them would have more than `max_nodes` nodes
void scan_fbx(std::string_view bytes, std::size_t max_nodes, const std::string& file);

}  // namespace anigen::io::assimp_import
