#include "anigen/io/gltf/import_joints.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/import_similarity.h"

namespace anigen::io::gltf_import {
namespace {

std::vector<char> used_skins(const Document& document) {
  std::vector<char> used(document.skins.size(), 0);
  for (std::size_t s = 0; s < used.size(); ++s) {
    const std::vector<int>& joints = document.skins[s].joints;
    used[s] = std::all_of(joints.begin(), joints.end(), [&](int n) { return document.in_scene[at(n)] != 0; }) ? 1 : 0;
  }
  for (std::size_t n = 0; n < document.nodes.size(); ++n) {
    const Node& node = document.nodes[n];
    if (document.in_scene[n] != 0 && node.mesh >= 0 && node.skin >= 0) used[at(node.skin)] = 1;
  }
  return used;
}

void promote_nodes(const Document& document, const std::vector<char>& moving, std::vector<char>& is_joint,
                   Notes& notes) {
  std::vector<char> rigid(document.nodes.size(), 0);
  for (std::size_t n = 0; n < rigid.size(); ++n) {
    const Node& node = document.nodes[n];
    rigid[n] = document.in_scene[n] != 0 && node.mesh >= 0 && node.skin < 0 ? 1 : 0;
  }
  const std::vector<int> joints_below = count_below(document, is_joint), rigid_below = count_below(document, rigid);
  std::size_t moved = 0, uneven = 0;
  for (std::size_t n = 0; n < rigid.size(); ++n) {
    if (is_joint[n] != 0) continue;
    const bool carries_motion = moving[n] != 0 && (joints_below[n] > 0 || rigid_below[n] > 0);
    const bool cannot_fold = joints_below[n] > 0 && !as_similarity(document.nodes[n].matrix);
    if (!carries_motion && !cannot_fold) continue;
    is_joint[n] = 1;
    ++(carries_motion ? moved : uneven);
  }
  if (moved + uneven == 0) return;
  notes.tally("promoted_node",
              "nodes became joints (" + std::to_string(moved) + " that move joints or meshes, " +
                  std::to_string(uneven) + " with uneven scale or shear above joints)",
              moved + uneven);
}

bool shows_triangles(const Document& document) {
  for (std::size_t n = 0; n < document.nodes.size(); ++n) {
    const int mesh = document.nodes[n].mesh;
    if (mesh < 0 || document.in_scene[n] == 0) continue;
    const std::vector<Primitive>& primitives = document.meshes[at(mesh)].primitives;
    if (std::any_of(primitives.begin(), primitives.end(), [](const Primitive& one) { return one.mode >= 4; }))
      return true;
  }
  return false;
}

/// A motion without a mesh: ends of chains often do not move themselves.
void mark_moving_trees(const Document& document, const std::vector<char>& moving, std::vector<char>& is_joint) {
  for (const int n : document.top_down) {
    const int parent = document.nodes[at(n)].parent;
    const bool below = parent >= 0 && is_joint[at(parent)] != 0;
    if (document.in_scene[at(n)] != 0 && (moving[at(n)] != 0 || below)) is_joint[at(n)] = 1;
  }
}

}  // namespace

std::vector<int> count_below(const Document& document, const std::vector<char>& marked) {
  std::vector<int> count(marked.begin(), marked.end());
  for (auto n = document.top_down.rbegin(); n != document.top_down.rend(); ++n) {
    const int parent = document.nodes[at(*n)].parent;
    if (parent >= 0) count[at(parent)] += count[at(*n)];
  }
  return count;
}

int common_ancestor(const Document& document, const std::vector<int>& nodes) {
  std::vector<char> marked(document.nodes.size(), 0);
  for (const int n : nodes) marked[at(n)] = 1;
  const std::vector<int> below = count_below(document, marked);
  int deepest = -1;
  for (const int n : document.top_down) {  // those with all of them below form one path downwards
    if (below[at(n)] == static_cast<int>(nodes.size())) deepest = n;
  }
  return deepest;
}

JointChoice choose_joints(const Document& document, const std::vector<char>& moving, bool require_skin, Notes& notes) {
  if (document.skins.empty() && require_skin)
    throw InputError(document.file, "/skins", "no skin: nothing to animate; export the mesh with its armature");
  JointChoice choice;
  choice.skin_used = used_skins(document);
  choice.is_joint.assign(document.nodes.size(), 0);
  bool any = false;
  for (std::size_t s = 0; s < document.skins.size(); ++s) {
    if (choice.skin_used[s] == 0) continue;
    any = true;
    for (const int n : document.skins[s].joints) choice.is_joint[at(n)] = 1;
  }
  if (!any && require_skin) throw InputError(document.file, "/skins", "no skin in this scene: nothing to animate");
  if (!any && shows_triangles(document)) return choice;
  if (!any) mark_moving_trees(document, moving, choice.is_joint);
  promote_nodes(document, moving, choice.is_joint, notes);
  return choice;
}

}  // namespace anigen::io::gltf_import
