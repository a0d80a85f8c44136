#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"

namespace anigen::mesh_health {

/// Told by long work how far it is: steps done of an expected total, which is only an estimate.
using StepReport = std::function<void(std::size_t done, std::size_t total)>;

/// Result of work that may run in a process of its own.
struct MeshResult {
  Mesh mesh;                        ///< vertices and faces alone
  std::vector<std::int32_t> place;  ///< as in Repaired, else empty
  Json figures;                     ///< an object
};

struct WorkLimits {
  double seconds = 0.0;      ///< of processor time; 0: a week
  std::uint64_t memory = 0;  ///< bytes beyond what this process has; 0: as much as the machine has
};

/// Runs work on a mesh in a copy of this process (run_guarded()), since CGAL can neither be interrupted nor told a
/// limit of time, and may end a process for a mesh that it did not expect. Shows progress by the steps that the work
/// reports. The work must use neither parallel_for nor the log.
/// @param label of the progress bar
/// @throws what the work throws of InputError and Error, with its message; Error when it passes a limit or crashes;
/// Interrupted after Ctrl-C
MeshResult run_limited(const std::string& label, const std::function<MeshResult(const StepReport&)>& work,
                       const WorkLimits& limits);

}  // namespace anigen::mesh_health
