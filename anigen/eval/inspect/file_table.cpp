#include "anigen/eval/inspect/file_table.h"

#include <algorithm>

namespace anigen::eval {
namespace {

std::string cell(const Json& description, const char* key) {
  return description.contains(key) ? description[key].dump() : std::string();
}

std::string repairs(const Json& description) {
  std::string text;
  if (!description.contains("notes")) return description.value("kind", "");
  for (const Json& note : description["notes"]) {
    text += (text.empty() ? "" : " ") + note["code"].get<std::string>();
  }
  return text;
}

std::string most_influences(const Json& description) {
  std::size_t most = 0;
  if (!description.contains("influences")) return "";
  for (const auto& [count, vertices] : description["influences"].items())
    most = std::max<std::size_t>(most, std::stoul(count));
  return std::to_string(most);
}

}  // namespace

Table file_table(const std::vector<InspectedFile>& files) {
  const bool losses = std::any_of(files.begin(), files.end(),
                                  [](const InspectedFile& f) { return f.description.contains("influence_loss"); });
  Table table{{"file", "joints", "vertices", "faces", "influences"}, {}};
  if (losses) {
    for (const char* name : {"affected", "max l1", "mean l1", "frames", "max shift / diagonal"})
      table.columns.push_back(name);
  }
  table.columns.push_back("repairs or rejection");
  for (const InspectedFile& file : files) {
    const Json& d = file.description;
    std::vector<std::string> row = {file.file, cell(d, "joints"), cell(d, "vertices"), cell(d, "faces"),
                                    most_influences(d)};
    if (losses && d.contains("influence_loss")) {
      const Json& loss = d["influence_loss"];
      row.push_back(loss["affected"].dump());
      row.push_back(fixed(loss["max_l1"].get<double>()));
      row.push_back(fixed(loss["mean_l1"].get<double>()));
      row.push_back(loss["frames"].dump());
      row.push_back(loss["frames"] == 0 ? "–" : fixed(loss["max_displacement"].get<double>()));
    } else if (losses) {
      row.resize(row.size() + 5);
    }
    row.push_back(file.rejection.empty() ? repairs(d) : "rejected: " + file.rejection);
    table.rows.push_back(std::move(row));
  }
  return table;
}

Json to_json(const std::vector<InspectedFile>& files) {
  Json list = Json::array();
  for (const InspectedFile& file : files) {
    list.push_back(file.rejection.empty() ? file.description : Json{{"file", file.file}, {"rejected", file.rejection}});
  }
  return files.size() == 1 ? list[0] : list;
}

}  // namespace anigen::eval
