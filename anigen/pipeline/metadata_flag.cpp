#include "anigen/pipeline/metadata_flag.h"

#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/core/group_lock.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

fs::path table_of(const fs::path& root) { return root / "metadata.csv"; }

/// Others hold it for one change of the table, so it is worth waiting for.
FileLock lock_table(const fs::path& root) {
  return wait_for_lock(dataset_lock_file(root).parent_path() / "lock-metadata", FileLock::Kind::kExclusive);
}

}  // namespace

FileLock share_dataset(const fs::path& root) {
  std::error_code error;
  // First, so that no lock file is made in a folder that is no dataset.
  if (!fs::is_regular_file(table_of(root), error)) throw InputError(table_of(root).string(), "", "no such file");
  std::optional<FileLock> lock;
  while_group_is_empty(dataset_prepare_lock_file(root),
                       [&] { lock = FileLock::try_lock(dataset_lock_file(root), FileLock::Kind::kShared); });
  if (!lock)
    throw InputError(root.string(), "", "anigen-prepare is working on this dataset; wait until it has finished");
  return std::move(*lock);
}

void set_metadata_flag(const fs::path& root, const std::string& column, const std::set<std::string>& ids) {
  const FileLock dataset = share_dataset(root);
  const FileLock lock = lock_table(root);
  const fs::path file = table_of(root);
  CsvTable table = read_csv(file);
  if (table.column("sha256") == CsvTable::kMissing) throw InputError(file.string(), "sha256", "no such column");
  const std::string before = to_csv(table);
  std::size_t place = table.column(column);
  if (place == CsvTable::kMissing) {
    place = table.columns.size();
    table.columns.push_back(column);
    for (auto& row : table.rows) row.emplace_back();
  }
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    table.rows[row][place] = csv_flag(ids.count(table.cell(row, "sha256")) > 0);
  }
  const std::string after = to_csv(table);
  if (after != before) write_file_atomically(file, after);
}

}  // namespace anigen::pipeline
