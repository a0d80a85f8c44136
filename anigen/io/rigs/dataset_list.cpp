#include "anigen/io/rigs/dataset_list.h"

#include <set>
#include <utility>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/io/rigs/split.h"

namespace anigen::io {

std::vector<DatasetItem> list_dataset(const std::filesystem::path& root) {
  const std::filesystem::path file = root / "metadata.csv";
  const CsvTable table = read_csv(file);
  if (table.column("sha256") == CsvTable::kMissing) throw InputError(file.string(), "line 1", "no column \"sha256\"");
  std::vector<DatasetItem> items;
  std::set<std::string> seen;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    DatasetItem item;
    item.id = table.cell(row, "sha256");
    const std::string place = "row " + std::to_string(row + 1);
    const bool unsafe = item.id.empty() || item.id == "." || item.id == ".." || item.id.find('/') != std::string::npos;
    if (unsafe) throw InputError(file.string(), place, "\"" + item.id + "\" is no id");
    if (!seen.insert(item.id).second) throw InputError(file.string(), place, "the id " + item.id + " appears twice");
    item.source = table.cell(row, "source");
    for (const char* column : {"local_path", "file_identifier", "sha256"}) {
      if (item.name.empty()) item.name = table.cell(row, column);
    }
    item.is_variant = !table.cell(row, "variant_of").empty();
    if (!item.is_variant) {
      item.uuid = table.cell(row, "uuid");
      for (const char* column : {"local_path", "file_identifier"}) {
        if (item.uuid.empty()) item.uuid = key_of_sample(table.cell(row, column));
      }
      for (const std::string& name : {item.uuid, table.cell(row, "local_path"), table.cell(row, "file_identifier")}) {
        if (!name.empty() && name != item.id) item.other_names.push_back(name);
      }
    }
    item.usable = !table.flag(row, "is_bad_skeleton", false, file.string());
    item.bad_skin = table.flag(row, "is_bad_skin", false, file.string());
    item.test = table.flag(row, "is_test", false, file.string());
    items.push_back(std::move(item));
  }
  return items;
}

}  // namespace anigen::io
