#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/rigging/pinocchio_discrete.h"
#include "anigen/rigging/pinocchio_template.h"

namespace anigen::rigging {

struct EmbeddedSkeleton {
  Skeleton skeleton;       ///< the mesh's frame and unit; names and order of the template, without its guides
  double penalty = 0.0;    ///< of the discrete embedding and of stretching; 1 or more: a rule was broken, it fits badly
  bool best = false;       ///< false: a good answer, not the one of least penalty (discrete_embedding())
  bool stretched = false;  ///< the template was stretched to the mesh's box (EmbeddingOptions::most_stretch)
  std::size_t spheres = 0;                   ///< that joints could be placed at
  int bridges = 0;                           ///< edges between pieces of the mesh that do not touch
  std::size_t states = 0;                    ///< partial embeddings that were looked into
  double energy_before = 0.0, energy = 0.0;  ///< of the refinement
};

/// A skeleton in a mesh after Baran and Popović, "Automatic rigging and animation of 3D characters" (2007;
/// docs/reference/riggers.md, 2): signed distances, spheres packed on the medial surface, the template's branches and
/// tips placed at spheres by best-first search, the other joints along the ways between, all of them refined at last.
///
/// Differences from the published program: the field is a regular grid, of the solid that a mesh of any quality
/// suggests; medial points lie between its cells rather than on the faces of an octree; the search knows better bounds
/// and so takes up fewer states for the same result; it always gives an answer, in bounded time and memory; and
/// a template may be stretched to the mesh's box.
/// Deterministic, whatever the number of threads.
/// @param mesh Z up, facing −Y, its left side towards +X; any unit. It need be neither closed nor of one piece
/// (solid_field() says what counts as its inside; pieces that do not touch are bridged where they are nearest).
/// @throws InputError for a mesh without faces or extent, bad indices, vertices that are not finite, bad options, or a
/// bad template
EmbeddedSkeleton embed_skeleton(const Mesh& mesh, const TemplateSkeleton& skeleton,
                                const EmbeddingOptions& options = {});

struct TemplateChoice {
  std::size_t index = 0;          ///< of the template with the least penalty, the first of equals
  EmbeddedSkeleton embedded;      ///< that one
  std::vector<double> penalties;  ///< [templates]; infinite where the search gave up, since another one costs less
};

/// Embeds every template and takes the one of least penalty; the mesh is made ready once.
/// @throws InputError without templates, and as embed_skeleton()
TemplateChoice choose_template(const Mesh& mesh, const std::vector<TemplateSkeleton>& templates,
                               const EmbeddingOptions& options = {});

}  // namespace anigen::rigging
