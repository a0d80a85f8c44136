#include "anigen/prepare/run/carried_columns.h"

#include <map>
#include <string>

namespace anigen::prepare {
namespace {

constexpr char kId[] = "sha256";

bool written_at_times(const std::string& column) {
  return column == "aesthetic_score" || column == "near_skeleton_of" || column.rfind("feature_", 0) == 0;
}

bool holds_flags(const CsvTable& table, std::size_t column) {
  bool any = false;
  for (const auto& row : table.rows) {
    if (row[column].empty()) continue;
    if (row[column] != csv_flag(true) && row[column] != csv_flag(false)) return false;
    any = true;
  }
  return any;
}

}  // namespace

void carry_over_columns(CsvTable& table, const CsvTable& earlier) {
  const std::size_t id = table.column(kId), earlier_id = earlier.column(kId);
  if (id == CsvTable::kMissing || earlier_id == CsvTable::kMissing) return;
  std::map<std::string, const std::vector<std::string>*> known;
  for (const auto& row : earlier.rows) known.emplace(row[earlier_id], &row);
  for (std::size_t column = 0; column < earlier.columns.size(); ++column) {
    const std::string& name = earlier.columns[column];
    if (table.column(name) != CsvTable::kMissing || written_at_times(name)) continue;
    const std::string unknown = holds_flags(earlier, column) ? csv_flag(false) : std::string();
    table.columns.push_back(name);
    for (auto& row : table.rows) {
      const auto found = known.find(row[id]);
      row.push_back(found == known.end() ? unknown : (*found->second)[column]);
    }
  }
}

}  // namespace anigen::prepare
