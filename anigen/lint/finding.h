#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"

namespace anigen::lint {

/// Weight of a finding, ascending.
enum class Severity {
  kNote,     ///< worth knowing; files that artists made have it
  kWarning,  ///< probably a mistake: look at it
  kError     ///< does not work as a rig, or loses data in other programs
};

/// "note", "warning", "error".
std::string to_string(Severity severity);
/// @throws InputError for another word
Severity parse_severity(const std::string& word);

/// The worst spot of a finding.
struct Place {
  std::string kind;  ///< "vertex", "joint", "face"; empty: the finding has no one place
  std::size_t index = 0;
  std::string name;                                    ///< of the joint; of a vertex or face the joint concerned
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< bind pose, the asset's frame and unit; may not be finite
};

/// One thing wrong with a rig. docs/lint.md lists the codes.
struct LintFinding {
  std::string code;  ///< stable: "unweighted-vertices"
  Severity severity = Severity::kWarning;
  std::size_t count = 0;  ///< vertices, joints or faces concerned
  double share = 0.0;     ///< of all of that kind, in [0, 1]
  Place place;
  std::string sentence;  ///< for people, without a full stop
};

/// Everything found, the gravest first, and the figures behind it, which are there without findings, too.
struct RigLint {
  std::vector<LintFinding> findings;
  Json figures = Json::object();  ///< plain numbers; lengths as parts of the diagonal of the mesh's bounding box

  /// Findings at or above a severity.
  std::size_t count(Severity least) const;
  /// Nullptr without.
  const LintFinding* find(const std::string& code) const;
};

/// {"findings": [{"code", "severity", "count", "share", "place", "sentence"}], "figures"}; a place without a kind is
/// left out, and numbers that are not finite become null.
Json to_json(const RigLint& lint);

/// One row per finding: severity, code, count, share, place, sentence.
Table finding_table(const RigLint& lint);

}  // namespace anigen::lint
