#include "anigen/eval/lint_files.h"

#include <functional>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/eval/inspect.h"
#include "anigen/io/rigs/rig_reader.h"

namespace anigen::eval {

namespace {

/// One rig, read and linted; a failure becomes its rejection.
LintedFile linted(const std::string& name, lint::LintOptions options, const std::function<io::ImportedAsset()>& read) {
  throw_if_interrupted();
  LintedFile result{name, {}, ""};
  try {
    const io::ImportedAsset imported = read();
    options.notes = imported.notes;
    result.lint = lint::lint_rig(imported.asset, options);
  } catch (...) {
    result.rejection = failure_of_item();
  }
  return result;
}

/// Kinds that RigReader reads, with notes whose codes say what was repaired.
bool is_listed(FileKind kind) {
  return kind == FileKind::kTextRig || kind == FileKind::kRigNpz || kind == FileKind::kShard ||
         kind == FileKind::kDataset || kind == FileKind::kFolder;
}

/// A file that may hold a mesh without a rig, which RigReader refuses and the checks find.
bool may_lack_rig(FileKind kind) { return is_geometry(kind) && !is_listed(kind); }

std::string counted(std::size_t count, const std::string& word) {
  return (count == 0 ? "no" : std::to_string(count)) + " " + word + (count == 1 ? "" : "s");
}

}  // namespace

std::vector<LintedFile> lint_path(const std::filesystem::path& path, const lint::LintOptions& options) {
  const FileKind kind = file_kind(path);
  if (may_lack_rig(kind)) return {linted(path.string(), options, [&] { return read_geometry(path, kind).imported; })};
  if (!is_listed(kind))
    throw InputError(path.string(), "", "--lint needs a rig, or a folder, dataset or shard of rigs");
  const io::RigReader reader;
  std::vector<LintedFile> files;
  for (const io::RigEntry& entry : io::list_rigs(path)) {
    const std::string name = entry.file.string() + (entry.key.empty() ? "" : "#" + entry.key);
    files.push_back(linted(name, options, [&] {
      const FileKind own = entry.key.empty() ? file_kind(entry.file) : FileKind::kShard;
      return may_lack_rig(own) ? read_geometry(entry.file, own).imported : reader.read(entry);
    }));
  }
  return files;
}

std::string to_text(const LintedFile& file) {
  if (!file.rejection.empty()) return file.file + ": rejected: " + file.rejection + "\n";
  const std::size_t errors = file.lint.count(lint::Severity::kError);
  const std::size_t warnings = file.lint.count(lint::Severity::kWarning) - errors;
  const std::size_t notes = file.lint.findings.size() - errors - warnings;
  const std::string head = file.file + ": " + counted(errors, "error") + ", " + counted(warnings, "warning") + ", " +
                           counted(notes, "note") + "\n";
  return file.lint.findings.empty() ? head : head + "\n" + to_markdown(lint::finding_table(file.lint)) + "\n";
}

Json to_json(const std::vector<LintedFile>& files) {
  Json list = Json::array();
  for (const LintedFile& file : files) {
    Json entry = {{"file", file.file}};
    if (file.rejection.empty()) {
      entry.update(lint::to_json(file.lint));
    } else {
      entry["rejected"] = file.rejection;
    }
    list.push_back(std::move(entry));
  }
  return files.size() == 1 ? list[0] : list;
}

}  // namespace anigen::eval
