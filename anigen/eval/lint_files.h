#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/lint/lint.h"

namespace anigen::eval {

/// A rig of a file and what lint_rig() said, or why the file was rejected.
struct LintedFile {
  std::string file;  ///< with "#<sample>" for one of several in a file
  lint::RigLint lint;
  std::string rejection;  ///< empty: not rejected
};

/// Lints the rigs that a path holds: one for a file with a mesh or a skeleton; every rig of a folder, dataset or shard
/// (list_rigs()), of which those that cannot be read are rejected one by one. The importer's repairs are findings, too.
/// @param options notes are replaced by the importer's
/// @throws InputError when nothing there can be a rig; Interrupted after Ctrl-C
std::vector<LintedFile> lint_path(const std::filesystem::path& path, const lint::LintOptions& options = {});

/// "file: 1 error, 2 warnings, no notes" and the table of findings, or the rejection.
std::string to_text(const LintedFile& file);

/// {"file", "findings", "figures"} or {"file", "rejected": reason}; a list unless there is one.
Json to_json(const std::vector<LintedFile>& files);

}  // namespace anigen::eval
