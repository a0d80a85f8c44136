#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"

namespace anigen::mesh_health {

struct CheckOptions {
  bool solid = false;              ///< open borders and parts that cross each other are findings, too
  bool self_intersections = true;  ///< look for faces that cross each other, which takes most of the time
};

/// A kind of defect of a surface.
struct MeshFinding {
  std::string code;  ///< "non-manifold-edges"
  std::size_t count = 0;
  std::string phrase;  ///< "3 non-manifold edges"
};

/// Figures of a surface. Vertices at one position count as one place, so that texture seams are no borders.
struct MeshFigures {
  std::size_t vertices = 0;           ///< of the file
  std::size_t places = 0;             ///< different positions of vertices
  std::size_t faces = 0;              ///< of the file
  std::size_t isolated_vertices = 0;  ///< of no face
  std::size_t degenerate_faces = 0;   ///< without area, or with two corners in one place
  std::size_t duplicate_faces = 0;    ///< with the three places of another face

  // Of the faces without repetitions and without those that name a place twice.
  std::size_t parts = 0;                  ///< pieces that hang together by edges
  std::size_t closed_parts = 0;           ///< of these, without a border and with two faces at every edge
  std::size_t inverted_parts = 0;         ///< closed, wound inward, and no cavity inside another closed part
  std::size_t border_edges = 0;           ///< with one face
  std::size_t borders = 0;                ///< chains of border edges that hang together
  std::size_t non_manifold_edges = 0;     ///< with more than two faces
  std::size_t non_manifold_vertices = 0;  ///< whose faces form several fans
  std::size_t misoriented_edges = 0;      ///< whose two faces disagree about which side is out
  std::size_t crossed_faces = 0;          ///< that cross or touch a face of their own part
  std::size_t crossed_parts_faces = 0;    ///< that cross or touch a face of another part
  std::size_t crossings = 0;              ///< pairs of faces, of one part or of two
  double area = 0.0;
  double volume = 0.0;     ///< signed, of the closed parts whose faces agree
  double mean_edge = 0.0;  ///< length of edges
  Box box;                 ///< of the places that faces use
  bool intersections_known = false;
  bool closed = false;    ///< every edge has at least two faces
  bool manifold = false;  ///< no non-manifold edges and vertices
  bool oriented = false;  ///< all faces agree with their neighbours, and no closed part is wound inward

  std::vector<MeshFinding> findings;
  /// One line: "sound; closed, 2 parts" or "not sound: 3 non-manifold edges, …; open, …".
  std::string verdict;
};

/// Measures a surface, in any frame and unit. The result does not depend on the order of faces.
/// @throws InputError as weld(), Interrupted
MeshFigures check_mesh(const Mesh& mesh, const CheckOptions& options = {});

Json to_json(const MeshFigures& figures);

}  // namespace anigen::mesh_health
