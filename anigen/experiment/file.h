#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::experiment {

/// Changes to the steps for one row of the results.
struct Variant {
  std::string name;
  Json changes = Json::object();  ///< step name → what merge_config() overlays on that step
};

/// A column of a results table.
struct Column {
  std::string key;    ///< column of the step's CSV file
  std::string label;  ///< as people read it; the key where the file says nothing
  enum class Better { kNone, kLower, kHigher } better = Better::kNone;
  int digits = 4;
};

/// A table of the report: what one step measured, a row per variant and method.
struct TableSpec {
  std::string title, step;
  std::string file = "metrics.csv";     ///< in the step's folder: one line per asset and method; a folder's name may be
                                        ///< *, as in "samples/*/scores.csv": the last one, numbers counting
  std::vector<std::string> methods;     ///< values of the column "method"; empty: all, in the file's order
  std::vector<std::string> not_ranked;  ///< methods to compare with that no method competes with, such as the truth
  std::vector<Column> columns;
};

/// A curve of the report, one line per variant and seed.
struct CurveSpec {
  std::string title, step, column;  ///< a column of the training run's metrics.csv
};

/// Pictures of the report.
struct PictureSpec {
  std::string title, step;
  std::string files;     ///< under the step's folder; a folder's name may be *, as in "*/preview.png"
  std::size_t most = 6;  ///< per variant, of the first seed
};

/// File of an asset within a step's folder.
struct AssetFiles {
  std::string label, step;
  std::string pattern;  ///< under the step's folder, as "*/mesh.glb": one star, which stands for the asset's name
};

/// A 3D view of the report: assets as GLB files, each as several steps have it, side by side. Shows what there is;
/// unlike tables and pictures it makes no step a goal.
struct ViewerSpec {
  std::string title;
  std::vector<AssetFiles> shown;
  std::size_t most = 3;  ///< assets
};

/// A sheet of every asset that was scored, from the best to the worst: small pictures of it, such as the condition
/// picture and what was made of it. For every variant, of the first seed; makes no step a goal.
struct SheetSpec {
  std::string title, step;        ///< the step whose metrics.csv says how good each is
  std::string method;             ///< value of its column "method"
  Column order;                   ///< the column to sort by; lower is better unless it says "higher"
  std::vector<AssetFiles> shown;  ///< PNG or JPEG files; the name of an asset is its id
  std::size_t most = 100;         ///< assets, evenly spaced when there are more
};

/// Results of every variant on common assets, side by side (variant_strip()). Makes no step a goal.
struct StripSpec {
  std::string title, step;
  std::string pattern;                   ///< under the step's folder, with one star, which stands for the asset's name
  int panels = 1;                        ///< pictures side by side in each file, equally wide
  int panel = 1;                         ///< the one to show, from 1
  int first_panel = 0;                   ///< the one to show once per asset, in front; 0: none
  std::size_t most = 6;                  ///< assets
  std::string value_step, value_method;  ///< whose metrics.csv has a number for below each picture; empty: none
  Column value;
};

/// One side of a claim: a row of a table.
struct ClaimSide {
  std::string variant;  ///< of the experiment
  std::string method;   ///< value of the column "method"; empty: the only one
  std::string step;     ///< whose numbers; the claim's where it names none
  std::string file;     ///< in the step's folder, likewise
  std::string key;      ///< of the column there; empty: the claim's
};

/// "variant, method", as far as they have names, else the step.
std::string side_text(const ClaimSide& side);

/// A statement of a paper that an experiment can confirm or refute: in one column `of` is better than `over`, by more
/// than `margin` (judge_claims()). With a negative margin: it is not worse by as much.
struct ClaimSpec {
  std::string text, source;  ///< the statement; table, figure or section of the paper
  Column column;             ///< has a better direction
  ClaimSide of, over;
  double margin = 0.0;
  std::optional<std::pair<double, double>> published;  ///< numbers of both sides in the paper
  /// "seconds" (with what comes before), "memory" (GB), "parameters" (millions), "training" (minutes): the sides are
  /// rows of the tables of costs, by `method`; empty: the sides have a column each
  std::string cost;
};

/// A method in a table of costs.
struct CostRow {
  std::string label;
  std::string step;                 ///< that makes its results
  std::string files;                ///< of the results under the step's folder, one per asset, as "*.glb"
  std::vector<std::string> before;  ///< steps that every asset also needs, such as the one that generates its mesh
  std::vector<std::string> models;  ///< steps that train what it loads: "slat_dae", or one model, "slat_dae/decoder"
};

/// A table of what methods cost for an asset: seconds, memory, parameters, training (method_costs()).
struct CostSpec {
  std::string title;
  std::vector<CostRow> rows;
};

/// A whole experiment, as its JSON file says it (docs/experiments.md).
struct Experiment {
  std::filesystem::path file;
  std::filesystem::path folder;  ///< relative paths begin here: "paths_from" of the file's folder; absolute
  std::string scale;             ///< of the file's "scales"; empty: as it is without one
  std::string title, purpose;
  Json steps;  ///< name → step, in the file's order; read one by one by read_step()
  std::vector<Variant> variants;
  std::vector<std::uint64_t> seeds;
  std::vector<std::string> seeded;  ///< steps that are run once per seed
  std::vector<std::string> goals;   ///< steps to reach; what they do not need is not run
  std::vector<TableSpec> tables;
  std::vector<CurveSpec> curves;
  std::vector<PictureSpec> pictures;
  std::vector<ViewerSpec> viewers;
  std::vector<SheetSpec> sheets;
  std::vector<StripSpec> strips;
  std::vector<ClaimSpec> claims;
  std::vector<CostSpec> costs;
};

/// Reads an experiment; `"extends"` works as in configs. Variants are a `"variants"` object, or the product of a
/// `"grid"`, or both multiplied; without either there is one variant without a name. `"goals"` are the steps that the
/// tables, curves, pictures, claims and costs speak of and those that the file names; all steps when it names none.
/// @param overrides path.to.key=value, applied to the whole file before it is read
/// @param scale word of "scales": changes to the whole file, or the name of a file of them; of steps that the
/// experiment has. Empty: none
/// @throws InputError naming file and JSON pointer
Experiment read_experiment(const std::filesystem::path& file, const std::vector<std::string>& overrides = {},
                           const std::string& scale = "");

/// Experiments that belong together: {"title": …, "purpose": …, "experiments": ["a.json", …]}.
struct Collection {
  std::string title, purpose;
  std::vector<std::filesystem::path> files;  ///< absolute
};

/// The collection that a file holds; nothing for the file of one experiment.
/// @throws InputError naming file and JSON pointer
std::optional<Collection> read_collection(const std::filesystem::path& file);

}  // namespace anigen::experiment
