#include "anigen/lint/lint.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>

#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/lint/joint_checks.h"
#include "anigen/lint/name_checks.h"
#include "anigen/lint/pose_checks.h"
#include "anigen/lint/weight_checks.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

namespace {

/// Coordinates beyond this are no object in any unit, and their squares leave single precision.
constexpr double kLargestCoordinate = 1e12;
/// Sentences of a broken asset that the finding repeats.
constexpr std::size_t kShownProblems = 3;

/// Finding that stands for a note of an importer.
struct NoteRow {
  const char* code;
  Severity severity;
  bool of_vertices;  ///< the number that the note begins with counts vertices, else joints
};

/// Notes that tell of defects; the others tell of conversions. No repaired defect is an error: what was read works.
const std::map<std::string, NoteRow>& rows_of_notes() {
  static const std::map<std::string, NoteRow> rows = {
      {"zero_weights", {"unweighted-vertices", Severity::kWarning, true}},
      {"nan_weights", {"bad-weights", Severity::kWarning, true}},
      {"negative_weights", {"bad-weights", Severity::kWarning, true}},
      {"unused_joint_index", {"bad-weights", Severity::kNote, true}},
      {"unnormalised_weights", {"weight-sums", Severity::kNote, true}},
      {"duplicate_joint_names", {"repeated-names", Severity::kNote, false}},
      {"several_roots", {"several-roots", Severity::kNote, false}},
      {"rest_pose_differs", {"rest-pose-differs", Severity::kNote, false}},
      {"missing_inverse_bind", {"repaired-bind", Severity::kNote, false}},
      {"repaired_inverse_bind", {"repaired-bind", Severity::kNote, false}},
      {"bind_pose_conflict", {"repaired-bind", Severity::kNote, false}},
      {"sheared_joint", {"repaired-bind", Severity::kNote, false}}};
  return rows;
}

void check_notes(const Asset& asset, const std::vector<io::ImportNote>& notes, RigLint& lint) {
  for (const io::ImportNote& note : notes) {
    const auto row = rows_of_notes().find(note.code);
    if (row == rows_of_notes().end()) continue;
    const std::size_t counted = std::strtoul(note.message.c_str(), nullptr, 10);
    const std::size_t count = std::max<std::size_t>(1, counted);
    const std::size_t all = row->second.of_vertices ? asset.mesh.vertices.size() : asset.skeleton.size();
    const double share = all == 0 ? 0.0 : std::min(1.0, static_cast<double>(count) / static_cast<double>(all));
    lint.findings.push_back({row->second.code, row->second.severity, count, share, {}, "in the file: " + note.message});
  }
}

/// Mesh, skeleton and weights with the rows and names put right that have checks of their own: rows divided by their
/// sum, without one on joint 0.
Asset repaired_copy(const Asset& asset) {
  Asset copy;
  copy.mesh.vertices = asset.mesh.vertices;
  copy.mesh.faces = asset.mesh.faces;
  copy.skeleton = asset.skeleton;
  if (copy.skeleton.names.size() == copy.skeleton.size()) {
    // Names are shown in findings, so they stay as far as they are unique and not empty.
    std::map<std::string, std::size_t> known;
    for (std::size_t j = 0; j < copy.skeleton.size(); ++j) {
      std::string& name = copy.skeleton.names[j];
      if (name.empty() || known[name]++ > 0) name += "#" + std::to_string(j);
      ++known[name];
    }
  }
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    std::vector<Influence> row;
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      if (influence.joint >= 0 && at(influence.joint) < asset.skeleton.size()) row.push_back(influence);
    }
    if (copy.skin.append_row(std::move(row))) continue;
    copy.skin.influences.push_back({0, 1.0f});
    copy.skin.offsets.back() = copy.skin.influences.size();
  }
  return copy;
}

bool too_large(const Asset& asset) {
  const auto large = [](double x) { return !(std::abs(x) <= kLargestCoordinate); };
  return std::any_of(asset.mesh.vertices.begin(), asset.mesh.vertices.end(),
                     [&](const Eigen::Vector3f& v) { return large(static_cast<double>(v.cwiseAbs().maxCoeff())); }) ||
         std::any_of(asset.skeleton.bind.begin(), asset.skeleton.bind.end(),
                     [&](const Eigen::Matrix4d& m) { return large(m.cwiseAbs().maxCoeff()); });
}

void add_broken(const std::vector<std::string>& problems, RigLint& lint) {
  std::string sentence = joined(
      std::vector<std::string>(
          problems.begin(), problems.begin() + static_cast<std::ptrdiff_t>(std::min(kShownProblems, problems.size()))),
      "; ");
  lint.findings.push_back({"broken-asset", Severity::kError, problems.size(), 1.0, {}, std::move(sentence)});
}

/// Missing parts. @return whether mesh, skeleton and weights are there
bool check_parts(const Asset& asset, RigLint& lint) {
  const std::size_t before = lint.findings.size();
  const auto missing = [&lint](const char* code, const char* sentence) {
    lint.findings.push_back({code, Severity::kError, 1, 1.0, {}, sentence});
  };
  if (asset.mesh.faces.empty() || asset.mesh.vertices.empty()) missing("no-mesh", "there is no mesh with faces");
  if (asset.skeleton.size() == 0) missing("no-skeleton", "there is no skeleton");
  if (asset.skin.influences.empty()) missing("no-weights", "there are no skin weights");
  return lint.findings.size() == before;
}

/// All checks, in the order of docs/lint.md. Those of geometry need a sound asset.
void run_checks(const Asset& asset, const LintOptions& options, RigLint& lint) {
  check_notes(asset, options.notes, lint);
  const bool has_parts = check_parts(asset, lint);
  if (!rows_are_readable(asset.skin)) {
    add_broken({"offsets of the skin's rows do not ascend to the number of its influences"}, lint);
    return;
  }
  if (asset.skin.rows() > 0 && asset.skin.rows() != asset.mesh.vertices.size()) {
    add_broken({"the skin has " + std::to_string(asset.skin.rows()) + " rows for " +
                std::to_string(asset.mesh.vertices.size()) + " vertices"},
               lint);
    return;
  }
  if (has_parts) check_rows(asset, lint);
  check_names(asset.skeleton, lint);
  const Asset sound = repaired_copy(asset);
  std::vector<std::string> problems = has_parts ? validate(sound, 1) : std::vector<std::string>{};
  if (problems.empty() && too_large(sound)) problems.emplace_back("a coordinate is not finite or beyond 1e12");
  if (!problems.empty()) add_broken(problems, lint);
  if (!problems.empty() || !has_parts) return;

  const WeldedRig rig(sound);
  lint.figures["shells"] = rig.shell_count;
  if (rig.faces.empty()) {
    add_broken({"no face has three different vertices"}, lint);
    return;
  }
  check_surface_weights(rig, lint);
  check_dead_joints(rig, lint);
  check_joint_places(rig, lint);
  check_bind_matrices(rig, lint);
  check_sides(rig, lint);
  if (options.poses) check_poses(rig, options.seed, lint);
}

}  // namespace

RigLint lint_rig(const Asset& asset, const LintOptions& options) {
  RigLint lint;
  lint.figures = {
      {"vertices", asset.mesh.vertices.size()}, {"faces", asset.mesh.faces.size()}, {"joints", asset.skeleton.size()}};
  run_checks(asset, options, lint);
  std::stable_sort(lint.findings.begin(), lint.findings.end(),
                   [](const LintFinding& a, const LintFinding& b) { return a.severity > b.severity; });
  return lint;
}

}  // namespace anigen::lint
