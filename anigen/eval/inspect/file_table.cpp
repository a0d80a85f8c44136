#include "anigen/eval/inspect/file_table.h"

#include <algorithm>

namespace anigen::eval {
namespace {

std::string cell(const Json& description, const char* key) {
  return description.contains(key) ? description[key].dump() : std::string();
}

/// "12 arrays, 345 numbers" of what a description counts under these keys.
std::string counts(const Json& description, const std::vector<std::pair<const char*, const char*>>& words) {
  std::string text;
  for (const auto& [key, word] : words) {
    const std::string value = cell(description, key);
    if (!value.empty()) text += (text.empty() ? "" : ", ") + value + " " + word;
  }
  return text;
}

std::string summary(const Json& description) {
  if (description.contains("width"))
    return description.value("format", "") + ", " + cell(description, "width") + " x " + cell(description, "height") +
           ", " + cell(description, "channels") + " channels of " + cell(description, "bits") + " bits";
  return counts(description, {{"samples", "samples"},
                              {"arrays", "arrays"},
                              {"numbers", "numbers"},
                              {"rows", "rows"},
                              {"checkpoint_steps", "checkpoint steps"},
                              {"files", "files"}});
}

std::string repairs(const Json& description) {
  std::string text;
  if (!description.contains("notes")) return summary(description);
  for (const Json& note : description["notes"]) {
    const std::string code = note["code"].get<std::string>();
    text += (text.empty() ? "" : " ") + (code == "note" ? note["message"].get<std::string>() : code);
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
  const bool kinds = std::any_of(files.begin(), files.end(), [](const InspectedFile& f) {
    return f.rejection.empty() && f.description.value("kind", "asset") != "asset";
  });
  Table table{{"file", "joints", "vertices", "faces", "influences"}, {}};
  if (kinds) table.columns.insert(table.columns.begin() + 1, "kind");
  if (losses) {
    for (const char* name : {"affected", "max l1", "mean l1", "frames", "max shift / diagonal"})
      table.columns.push_back(name);
  }
  table.columns.push_back("repairs or rejection");
  for (const InspectedFile& file : files) {
    const Json& d = file.description;
    std::vector<std::string> row = {file.file, cell(d, "joints"), cell(d, "vertices"), cell(d, "faces"),
                                    most_influences(d)};
    if (kinds) row.insert(row.begin() + 1, file.rejection.empty() ? d.value("kind", "") : "");
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
