#include "anigen/experiment/file.h"

#include <algorithm>
#include <set>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/experiment/plan.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostVariants = 256, kMostSeeds = 64;

/// Names become parts of file names and of placeholders.
void require_name(const ConfigReader& reader, const std::string& key, const std::string& name) {
  const bool fine = !name.empty() && name.size() <= 40 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
  if (!fine) throw reader.error(key, "names of steps are made of 1 to 40 letters, digits and '_'");
}

std::vector<Json> list_of(ConfigReader& reader, const std::string& key) {
  const Json* value = reader.raw(key);
  if (value == nullptr) return {};
  if (!value->is_array()) throw reader.error(key, "expected a list");
  return {value->begin(), value->end()};
}

void read_step_name(ConfigFields& f, const Json& steps, std::string& step) {
  f("step", step, kRequired);
  require_step(steps, f.reader(), "step", step);
}

/// The variants that one entry of "grid" stands for: {"step": "ss_flow", "set": "path.to.key", "values": […]}.
std::vector<Variant> axis_of(const Json& json, const Json& steps, const std::string& file, const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  ConfigFields f(reader);
  reader.require("values");
  std::string step, path;
  read_step_name(f, steps, step);
  f("set", path, kRequired);
  const std::string label = reader.text("label", path.substr(path.find_last_of('.') + 1));
  std::vector<Variant> axis;
  for (const Json& value : list_of(reader, "values")) {
    const std::string text = value.is_string() ? value.get<std::string>() : value.dump();
    Variant variant{label + "=" + text, Json::object()};
    variant.changes[step]["set"][path] = value;
    axis.push_back(std::move(variant));
  }
  if (axis.empty()) throw reader.error("values", "at least one is needed");
  reader.finish();
  return axis;
}

std::vector<Variant> product(const std::vector<Variant>& first, const std::vector<Variant>& second,
                             const std::string& file) {
  if (first.size() * second.size() > kMostVariants)
    throw InputError(file, "/grid", "more than " + std::to_string(kMostVariants) + " variants");
  std::vector<Variant> all;
  for (const Variant& a : first) {
    for (const Variant& b : second) {
      Variant both{a.name + (a.name.empty() || b.name.empty() ? "" : ", ") + b.name, a.changes};
      merge_config(both.changes, b.changes);
      all.push_back(std::move(both));
    }
  }
  return all;
}

std::vector<Variant> read_variants(ConfigReader& reader, const Json& steps) {
  std::vector<Variant> variants{Variant{}};
  if (reader.has("variants")) {
    ConfigReader named = reader.object("variants");
    variants.clear();
    for (const auto& [name, changes] : reader.raw("variants")->items()) {
      const Json& object = *named.raw(name);
      if (object.is_null()) continue;  // one of the extended file, taken back
      ConfigReader inner(object, named.file(), named.pointer_to(name));
      for (const auto& [step, unused] : object.items()) {
        require_step(steps, inner, step, step);
        inner.object(step);
      }
      variants.push_back({name, changes});
    }
    if (variants.empty()) throw reader.error("variants", "at least one is needed");
  }
  const std::vector<Json> grid = list_of(reader, "grid");
  for (std::size_t i = 0; i < grid.size(); ++i)
    variants = product(variants, axis_of(grid[i], steps, reader.file(), "/grid/" + std::to_string(i)), reader.file());
  if (variants.size() > kMostVariants)
    throw reader.error("variants", "more than " + std::to_string(kMostVariants) + " variants");
  return variants;
}

Column read_column(const Json& json, const std::string& file, const std::string& pointer) {
  Column column;
  if (json.is_string()) {
    column.key = column.label = json.get<std::string>();
    return column;
  }
  ConfigReader reader(json, file, pointer);
  ConfigFields f(reader);
  f("key", column.key, kRequired);
  column.label = column.key;
  f("label", column.label);
  using Better = Column::Better;
  f("better", column.better, {{"none", Better::kNone}, {"lower", Better::kLower}, {"higher", Better::kHigher}});
  f("digits", column.digits, {0, 9});
  reader.finish();
  return column;
}

Column needed_column(ConfigReader& reader, const std::string& key) {
  reader.require(key);
  return read_column(*reader.raw(key), reader.file(), reader.pointer_to(key));
}

/// Pattern of the files of all assets: the name of an asset is its star.
void read_pattern(ConfigFields& f, std::string& pattern) {
  f("files", pattern, kRequired);
  if (std::count(pattern.begin(), pattern.end(), '*') != 1)
    throw f.error("files", "one * is needed, where the name of the asset stands, as in \"*/preview.png\"");
}

/// Calls `read` for every object of a list and refuses what it did not ask for.
template <typename Read>
void each_object(ConfigReader& reader, const std::string& key, Read read) {
  const std::vector<Json> list = list_of(reader, key);
  for (std::size_t i = 0; i < list.size(); ++i) {
    ConfigReader item(list[i], reader.file(), reader.pointer_to(key) + "/" + std::to_string(i));
    ConfigFields f(item);
    read(f);
    item.finish();
  }
}

/// Reads a list of parts of the report that are about one step each; `specs` gets one more for each.
template <typename Spec, typename Read>
void each_part(ConfigReader& reader, const std::string& key, const Json& steps, std::vector<Spec>& specs, Read read) {
  each_object(reader, key, [&](ConfigFields& f) {
    Spec& spec = specs.emplace_back();
    f("title", spec.title, kRequired);
    read_step_name(f, steps, spec.step);
    read(f, spec);
  });
}

std::vector<AssetFiles> read_shown(ConfigReader& reader, const Json& steps) {
  std::vector<AssetFiles> entries;
  each_object(reader, "shown", [&](ConfigFields& f) {
    AssetFiles& entry = entries.emplace_back();
    read_step_name(f, steps, entry.step);
    entry.label = entry.step;
    f("label", entry.label);
    read_pattern(f, entry.pattern);
  });
  if (entries.empty()) throw reader.error("shown", "at least one is needed");
  return entries;
}

void read_strip(ConfigFields& f, const Json& steps, StripSpec& strip) {
  read_pattern(f, strip.pattern);
  f("panels", strip.panels, {1, 100});
  f("panel", strip.panel, {1, strip.panels});
  f("first_panel", strip.first_panel, {0, strip.panels});
  f("most", strip.most, {1, 200});
  if (!f.reader().has("value")) return;
  f.object("value", [&](ConfigFields& value) {
    read_step_name(value, steps, strip.value_step);
    value("method", strip.value_method, kRequired);
    strip.value = needed_column(value.reader(), "column");
  });
}

/// @param side with the claim's own step and file
void read_side(ConfigFields& f, const Experiment& experiment, const std::string& key, ClaimSide& side) {
  side.variant = experiment.variants.front().name;
  const auto read = [&](ConfigFields& fields) {
    fields("variant", side.variant);
    fields("method", side.method);
    fields("step", side.step);
    fields("file", side.file);
    fields("key", side.key);
    const auto is_named = [&](const Variant& variant) { return variant.name == side.variant; };
    if (std::none_of(experiment.variants.begin(), experiment.variants.end(), is_named))
      throw fields.error("variant", "\"" + side.variant + "\" is no variant of this experiment");
    if (!side.step.empty()) require_step(experiment.steps, fields.reader(), "step", side.step);
  };
  if (f.reader().has(key)) f.object(key, read);
  if (side.step.empty()) throw f.error("step", "is missing");
}

void read_published(ConfigFields& f, ClaimSpec& claim) {
  std::vector<double> published;
  f("published", published);
  if (!published.empty() && published.size() != 2) throw f.error("published", "expected two numbers, of both sides");
  if (!published.empty()) claim.published = {published[0], published[1]};
}

/// Sides of a claim about costs: rows by their labels.
void read_cost_sides(ConfigFields& f, const Experiment& experiment, ClaimSpec& claim) {
  claim.column = {claim.cost, claim.cost, Column::Better::kLower, 2};
  const auto read = [&](const std::string& key, ClaimSide& side) {
    f(key, side.method, kRequired);
    for (const CostSpec& spec : experiment.costs) {
      for (const CostRow& row : spec.rows) {
        if (row.label == side.method) side.step = row.step;
      }
    }
    if (side.step.empty()) throw f.error(key, "\"" + side.method + "\" is no row of \"costs\"");
  };
  read("of", claim.of);
  read("over", claim.over);
  if (claim.of.method == claim.over.method) throw f.error("over", "both sides of the claim are the same");
}

void read_claims(Experiment& experiment, ConfigReader& reader) {
  each_object(reader, "claims", [&](ConfigFields& f) {
    ClaimSpec& claim = experiment.claims.emplace_back();
    f("claim", claim.text, kRequired);
    f("source", claim.source, kRequired);
    f("cost", claim.cost, {"", "seconds", "memory", "parameters", "training"});
    f("margin", claim.margin, {-1e9, 1e9});
    read_published(f, claim);
    if (!claim.cost.empty()) {
      read_cost_sides(f, experiment, claim);
      return;
    }
    claim.of.file = "metrics.csv";
    f("step", claim.of.step);
    f("file", claim.of.file);
    claim.over = claim.of;
    claim.column = needed_column(f.reader(), "column");
    if (claim.column.better == Column::Better::kNone)
      throw f.error("column", "a claim needs to know which is \"better\": lower or higher");
    read_side(f, experiment, "of", claim.of);
    read_side(f, experiment, "over", claim.over);
    if (claim.of.variant == claim.over.variant && claim.of.method == claim.over.method &&
        claim.of.step == claim.over.step && claim.of.file == claim.over.file && claim.of.key == claim.over.key)
      throw f.error("over", "both sides of the claim are the same");
  });
}

void read_costs(Experiment& experiment, ConfigReader& reader) {
  const Json& steps = experiment.steps;
  each_object(reader, "costs", [&](ConfigFields& f) {
    CostSpec& spec = experiment.costs.emplace_back();
    f("title", spec.title, kRequired);
    each_object(f.reader(), "rows", [&](ConfigFields& of_row) {
      CostRow& row = spec.rows.emplace_back();
      of_row("label", row.label, kRequired);
      read_step_name(of_row, steps, row.step);
      read_pattern(of_row, row.files);
      of_row("before", row.before);
      of_row("models", row.models);
      for (const std::string& step : row.before) require_step(steps, of_row.reader(), "before", step);
      for (const std::string& model : row.models)
        require_step(steps, of_row.reader(), "models", model.substr(0, model.find('/')));
    });
    if (spec.rows.empty()) throw f.error("rows", "at least one is needed");
  });
}

void read_report(Experiment& experiment, ConfigReader& reader) {
  const Json& steps = experiment.steps;
  each_part(reader, "tables", steps, experiment.tables, [](ConfigFields& f, TableSpec& table) {
    f("file", table.file);
    f("methods", table.methods);
    f("not_ranked", table.not_ranked);
    ConfigReader& item = f.reader();
    const std::vector<Json> columns = list_of(item, "columns");
    for (std::size_t c = 0; c < columns.size(); ++c)
      table.columns.push_back(read_column(columns[c], item.file(), item.pointer_to("columns/" + std::to_string(c))));
    if (table.columns.empty()) throw item.error("columns", "at least one is needed");
  });
  each_part(reader, "curves", steps, experiment.curves,
            [](ConfigFields& f, CurveSpec& curve) { f("column", curve.column, kRequired); });
  each_part(reader, "pictures", steps, experiment.pictures, [](ConfigFields& f, PictureSpec& picture) {
    f("files", picture.files, kRequired);
    f("most", picture.most, {1, 200});
  });
  each_part(reader, "sheets", steps, experiment.sheets, [&](ConfigFields& f, SheetSpec& sheet) {
    f("method", sheet.method, kRequired);
    sheet.order = needed_column(f.reader(), "order");
    sheet.shown = read_shown(f.reader(), steps);
    f("most", sheet.most, {3, 1000});
  });
  each_part(reader, "strips", steps, experiment.strips,
            [&](ConfigFields& f, StripSpec& strip) { read_strip(f, steps, strip); });
  each_object(reader, "viewers", [&](ConfigFields& f) {
    ViewerSpec& viewer = experiment.viewers.emplace_back();
    f("title", viewer.title, kRequired);
    f("most", viewer.most, {1, 100});
    viewer.shown = read_shown(f.reader(), steps);
  });
}

void read_seeds(Experiment& experiment, ConfigReader& reader) {
  for (const std::int64_t seed : reader.integers("seeds", {0})) {
    if (seed < 0) throw reader.error("seeds", "must not be negative");
    experiment.seeds.push_back(static_cast<std::uint64_t>(seed));
  }
  const std::set<std::uint64_t> different(experiment.seeds.begin(), experiment.seeds.end());
  if (experiment.seeds.empty() || experiment.seeds.size() > kMostSeeds || different.size() != experiment.seeds.size())
    throw reader.error("seeds", "expected 1 to " + std::to_string(kMostSeeds) + " different numbers");
  experiment.seeded = reader.texts("seeded", {});
  for (const std::string& step : experiment.seeded) require_step(experiment.steps, reader, "seeded", step);
  if (experiment.seeds.size() > 1 && experiment.seeded.empty())
    throw reader.error("seeded", "several seeds, but no step that takes them: name the steps to repeat");
}

void read_goals(Experiment& experiment, ConfigReader& reader) {
  std::vector<std::string>& goals = experiment.goals;
  if (reader.has("goals")) {
    goals = reader.texts("goals", {});
    for (const std::string& step : goals) require_step(experiment.steps, reader, "goals", step);
    for (const TableSpec& table : experiment.tables) goals.push_back(table.step);
    for (const CurveSpec& curve : experiment.curves) goals.push_back(curve.step);
    for (const PictureSpec& picture : experiment.pictures) goals.push_back(picture.step);
    for (const ClaimSpec& claim : experiment.claims) goals.insert(goals.end(), {claim.of.step, claim.over.step});
    for (const CostSpec& spec : experiment.costs) {
      for (const CostRow& row : spec.rows) goals.push_back(row.step);
    }
    if (goals.empty()) throw reader.error("goals", "names no step, and no table, curve, picture, claim or cost does");
  } else {
    for (const auto& [step, unused] : experiment.steps.items()) goals.push_back(step);
  }
}

/// Overlays what the file's "scales" have under a word. Changes of steps that the experiment does not have are left
/// out, so that experiments which share their steps can share a scale.
void apply_scale(Json& json, const fs::path& file, const std::string& scale) {
  ConfigReader reader(json, file.string());
  ConfigReader scales = reader.object("scales");
  Json changes = Json::object();
  if (const Json* all = reader.raw("scales")) {
    std::vector<std::string> words;
    for (const auto& [word, unused] : all->items()) words.push_back(word);
    if (!scale.empty() && !scales.has(scale))
      throw InputError(file.string(), "--scale", "\"" + scale + "\" is none of its scales: " + joined(words));
    if (!scale.empty()) changes = (*all)[scale];
  } else if (!scale.empty()) {
    throw InputError(file.string(), "--scale", "has no scales");
  }
  if (changes.is_string()) changes = load_config(fs::absolute(file).parent_path() / changes.get<std::string>());
  if (!changes.is_object()) throw scales.error(scale, "expected changes to the file, or the name of a file of them");
  if (changes.contains("steps") && changes["steps"].is_object() && json.contains("steps")) {
    Json known = Json::object();
    for (const auto& [step, value] : changes["steps"].items())
      if (json["steps"].contains(step)) known[step] = value;
    changes["steps"] = known;
  }
  json.erase("scales");
  merge_config(json, changes);
}

}  // namespace

std::string side_text(const ClaimSide& side) {
  const std::string named = side.variant + (side.variant.empty() || side.method.empty() ? "" : ", ") + side.method;
  return named.empty() ? side.step : named;
}

std::optional<Collection> read_collection(const fs::path& file) {
  const Json json = load_config(file);
  if (!json.is_object() || !json.contains("experiments")) return std::nullopt;
  ConfigReader reader(json, file.string());
  reader.require("title");
  Collection collection;
  collection.title = reader.text("title", "");
  collection.purpose = reader.text("purpose", "");
  for (const std::string& name : reader.texts("experiments", {}))
    collection.files.push_back((fs::absolute(file).parent_path() / name).lexically_normal());
  if (collection.files.empty()) throw reader.error("experiments", "at least one is needed");
  std::set<fs::path> stems;
  for (const fs::path& one : collection.files)
    if (!stems.insert(one.stem()).second) throw reader.error("experiments", "two are called " + one.stem().string());
  reader.finish();
  return collection;
}

Experiment read_experiment(const fs::path& file, const std::vector<std::string>& overrides, const std::string& scale) {
  Json json = load_config(file);
  apply_scale(json, file, scale);
  apply_overrides(json, overrides);
  ConfigReader reader(json, file.string());
  for (const char* key : {"title", "steps"}) reader.require(key);
  Experiment experiment;
  experiment.file = file;
  experiment.scale = scale;
  experiment.folder = (fs::absolute(file).parent_path() / reader.text("paths_from", ".")).lexically_normal();
  experiment.title = reader.text("title", "");
  experiment.purpose = reader.text("purpose", "");
  ConfigReader steps = reader.object("steps");
  experiment.steps = *reader.raw("steps");
  if (experiment.steps.empty()) throw reader.error("steps", "at least one is needed");
  for (const auto& [name, unused] : experiment.steps.items()) {
    require_name(steps, name, name);
    steps.object(name);
  }
  experiment.variants = read_variants(reader, experiment.steps);
  read_seeds(experiment, reader);
  read_report(experiment, reader);
  read_costs(experiment, reader);
  read_claims(experiment, reader);
  read_goals(experiment, reader);
  reader.finish();
  for (const Variant& variant : experiment.variants) {
    for (const auto& [name, unused] : experiment.steps.items()) read_step(experiment, variant, name);
  }
  return experiment;
}

}  // namespace anigen::experiment
