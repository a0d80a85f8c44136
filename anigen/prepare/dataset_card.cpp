#include "anigen/prepare/dataset_card.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <numeric>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/text.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/steps.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::prepare {

namespace {

/// The smallest of 1, 2, 5 times a power of ten that is not below a positive number.
double round_up(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (step * decade >= value * (1.0 - 1e-9)) return step * decade;
  }
  return 10.0 * decade;
}

std::vector<double> equal_edges(double low, double high, std::size_t most) {
  const double width = high > low ? round_up((high - low) / static_cast<double>(most - 1)) : 1.0;
  std::vector<double> edges{std::floor(low / width) * width};
  while (edges.back() <= high && edges.size() <= most)
    edges.push_back(edges.front() + width * static_cast<double>(edges.size()));
  return edges;
}

/// 1, 2, 5, 10, …: every number is at most 2.5 times the one before. Decades only when that makes too many.
std::vector<double> decade_edges(double low, double high, std::size_t most) {
  const double first = std::pow(10.0, std::floor(std::log10(low)));
  for (const std::vector<double>& steps : {std::vector<double>{1, 2, 5}, std::vector<double>{1}}) {
    std::vector<double> edges;
    for (double decade = first; edges.empty() || edges.back() <= high; decade *= 10.0) {
      for (const double step : steps) {
        if (edges.empty() || edges.back() <= high) edges.push_back(step * decade);
      }
    }
    while (edges.size() > 2 && edges[1] <= low) edges.erase(edges.begin());
    if (edges.size() <= most + 1) return edges;
  }
  return {low, high};
}

std::string short_number(double value) {
  if (value >= 1e6) return significant(value / 1e6, 3) + "M";
  if (value >= 1e3) return significant(value / 1e3, 3) + "k";
  return significant(value, 3);
}

CardHistogram histogram_of(const std::string& title, std::vector<double> values) {
  const std::vector<HistogramBin> bins = histogram(values);  // none without values
  if (values.empty()) values.push_back(0.0);
  std::sort(values.begin(), values.end());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  return {title,
          short_number(values.front()) + " to " + short_number(values.back()) + ", median " +
              short_number(values[values.size() / 2]) + ", mean " + short_number(mean),
          bins};
}

/// Lines "low - high  ######  count" for a code block.
std::string histogram_text(const std::vector<HistogramBin>& bins) {
  std::size_t tallest = 1;
  for (const HistogramBin& bin : bins) tallest = std::max(tallest, bin.count);
  std::string text;
  for (const HistogramBin& bin : bins) {
    const std::size_t length = (40 * bin.count + tallest - 1) / tallest;
    char line[96];
    std::snprintf(line, sizeof line, "%8s - %-8s %-40s %zu\n", short_number(bin.low).c_str(),
                  short_number(bin.high).c_str(), std::string(length, '#').c_str(), bin.count);
    text += line;
  }
  return text;
}

/// The card shows this many failures; failures.jsonl has all.
constexpr std::size_t kMostFailures = 50;

std::string text(std::size_t count) { return std::to_string(count); }

std::string mib_text(std::uintmax_t bytes) { return fixed(static_cast<double>(bytes) / 1048576.0, 2); }

std::vector<std::vector<std::string>> counts_of(const DatasetRows& found, const PrepareSummary& summary) {
  return {{"assets", text(summary.prepared())},
          {"posed variants", text(summary.variants)},
          {"poses given up as degenerate", text(summary.rejected_poses)},
          {"train", text(summary.train)},
          {"test", text(summary.test)},
          {"is_bad_skeleton", text(summary.bad_skeleton)},
          {"is_bad_skin", text(summary.bad_skin)},
          {"rejected sources and variants", text(found.rejected.size())},
          {"steps that failed", text(summary.failed_steps)},
          {"MiB", mib_text(summary.bytes)},
          {"KiB per asset and variant",
           found.rows.empty() ? "0" : text(static_cast<std::size_t>(summary.bytes / found.rows.size() / 1024))}};
}

/// Counts of words as a table.
CardTable counted(CardTable table, const std::map<std::string, std::size_t>& counts) {
  for (const auto& [word, count] : counts) table.rows.push_back({word, text(count)});
  return table;
}

// Sum and largest of a count over assets.
struct CountOverAssets {
  std::size_t sum = 0, most = 0;

  void add(std::size_t count) {
    sum += count;
    most = std::max(most, count);
  }
  std::string mean_and_most(std::size_t assets) const {
    return fixed(static_cast<double>(sum) / static_cast<double>(assets), 1) + " / " + text(most);
  }
};

// The assets of one source: a row of the table of sources.
struct SourceSum {
  std::string category;
  std::size_t assets = 0, animated = 0;
  CountOverAssets joints, bones, vertices;

  void add(const AssetRecord& record) {
    ++assets;
    animated += record.animations > 0 ? 1 : 0;
    joints.add(record.num_joints);
    bones.add(record.num_joints - std::min<std::size_t>(1, record.num_joints));
    vertices.add(record.num_vertices);
  }
  std::vector<std::string> cells(const std::string& name) const {
    return {name,
            text(assets),
            category,
            text(animated),
            joints.mean_and_most(assets),
            bones.mean_and_most(assets),
            vertices.mean_and_most(assets)};
  }
};

// A row per source, as the table of datasets of Anymate's paper has one per dataset, and one for all. Every asset has a
// rig, so that there is no column for it.
CardTable source_table(const DatasetRows& found) {
  constexpr const char *kProcedural = "procedural:", *kNotStated = "not stated";
  std::map<std::string, SourceSum> sums;
  SourceSum all;
  std::set<std::string> families;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;
    const AssetRecord& record = row.entry.record;
    const bool procedural = row.entry.source.procedural();
    SourceSum& sum = sums[record.source + (procedural ? "" : std::string(", ") + io::name_of(row.entry.source.format))];
    const bool family = record.source.rfind(kProcedural, 0) == 0;
    sum.category = family ? record.source.substr(std::string(kProcedural).size()) : kNotStated;
    if (family) families.insert(sum.category);
    sum.add(record);
    all.add(record);
  }
  CardTable table{"Sources",
                  "Bones are joints other than the root; joints, bones and vertices per asset: mean / most. Animated: "
                  "with clips of its own.",
                  {"source", "assets", "category", "animated", "joints", "bones", "vertices"},
                  {}};
  for (const auto& [name, sum] : sums) table.rows.push_back(sum.cells(name));
  all.category = families.empty() ? kNotStated : text(families.size()) + " families";
  if (sums.size() > 1) table.rows.push_back(all.cells("all"));
  return table;
}

CardTable cleaning_table(const DatasetRows& found) {
  CleaningCounts counts;
  std::size_t near = 0;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;  // they inherit those of their source
    count(row.entry.record.findings, counts);
    near += !row.near_skeleton_of.empty();
  }
  for (const Rejected& one : found.rejected) {
    if (!one.rule.empty()) ++counts[one.rule]["dropped"];
  }
  if (near > 0) counts["near_duplicate_skeleton"]["flagged"] += near;
  CardTable table{"Cleaning", "Assets per rule and action.", {"rule", "action", "assets"}, {}};
  for (const auto& [rule, actions] : counts) {
    for (const auto& [action, n] : actions) table.rows.push_back({rule, action, text(n)});
  }
  return table;
}

CardTable repair_table(const DatasetRows& found) {
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;
    for (const std::string& code : row.entry.record.repairs) ++counts[code];
  }
  return counted(
      {"Repairs by the importers", "Notes of the importers, which `anigen-inspect` explains.", {"code", "assets"}, {}},
      counts);
}

CardTable pose_table(const DatasetRows& found) {
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) ++counts[row.columns(kImport).at("pose").value("kind", std::string("unknown"))];
  }
  return counted({"Posed variants", "", {"pose from", "variants"}, {}}, counts);
}

CardTable step_table(const DatasetRows& found) {
  struct Sum {
    std::size_t assets = 0, files = 0;
    std::uintmax_t bytes = 0;
  };
  std::map<std::string, Sum> sums;
  for (const DatasetRow& row : found.rows) {
    for (const auto& [name, step] : row.records.steps) {
      Sum& sum = sums[name];
      ++sum.assets;
      sum.files += step.files;
      sum.bytes += step.bytes;
    }
  }
  CardTable table{"Steps", "", {"step", "assets", "files", "MiB"}, {}};
  for (const auto& [name, sum] : sums) {
    table.rows.push_back({name, text(sum.assets), text(sum.files), mib_text(sum.bytes)});
  }
  return table;
}

CardTable failure_table(const DatasetRows& found) {
  CardTable table{"Failures", "", {"source", "step", "reason"}, {}};
  for (const auto& [source, failure] : found.failures) {
    if (table.rows.size() == kMostFailures) break;
    const std::string pose = failure.variant == 0 ? "" : ", pose " + text(failure.variant - 1);
    table.rows.push_back({source.file_identifier + pose, failure.step, failure.reason});
  }
  if (found.failures.size() > kMostFailures) {
    table.note =
        "The first " + text(kMostFailures) + " of " + text(found.failures.size()) + "; failures.jsonl has all.";
  }
  return table;
}

CardFacts card_facts(const DatasetRows& found, const PrepareSummary& summary, const StepPlan& plan) {
  std::vector<double> joints, vertices, voxels, skeleton_voxels;
  for (const DatasetRow& row : found.rows) {
    if (row.variant == 0) {
      joints.push_back(static_cast<double>(row.entry.record.num_joints));
      vertices.push_back(static_cast<double>(row.entry.record.num_vertices));
    }
    if (!row.records.has("voxels")) continue;
    voxels.push_back(row.columns("voxels").value("num_voxels", 0.0));
    skeleton_voxels.push_back(row.columns("voxels").value("num_skeleton_voxels", 0.0));
  }
  CardFacts facts;
  facts.counts = counts_of(found, summary);
  facts.tables = {source_table(found), step_table(found),   cleaning_table(found),
                  pose_table(found),   repair_table(found), failure_table(found)};
  facts.histograms = {histogram_of("Joints", joints), histogram_of("Vertices", vertices)};
  if (!voxels.empty()) {
    facts.histograms.push_back(histogram_of("Surface voxels", voxels));
    facts.histograms.push_back(histogram_of("Skeleton voxels", skeleton_voxels));
  }
  facts.settings = Json(plan).dump(2);
  return facts;
}

constexpr std::size_t kMostTiles = 24;
constexpr int kTileSize = 192;

std::optional<render::Tile> tile_of(const std::filesystem::path& out, const DatasetRow& row) {
  const AssetPlaces places{out, row.entry.id};
  try {
    Asset asset;
    if (row.records.has("asset")) {
      asset = io::read_gltf(places.asset()).asset;
    } else if (row.records.has("skeleton")) {
      asset = io::to_asset(io::read_rig_npz(places.skeleton(), row.entry.id));
    } else {
      return std::nullopt;
    }
    render::PictureOptions options;
    options.width = options.height = kTileSize;
    options.ambient_occlusion = false;
    options.skeleton = true;
    const std::string caption = row.entry.id.substr(0, 8) + (row.variant > 0 ? " posed" : "") + ", " +
                                std::to_string(row.entry.record.num_joints) + " joints";
    return render::Tile{render::render(asset, options), caption};
  } catch (const std::exception&) {
    return std::nullopt;  // a card is not the place to fail over one picture
  }
}

/// A contact sheet of assets spread evenly over the dataset, from what the dataset holds: assets/<id>.glb, else
/// skeleton_voxelized.npz. @return nothing when it holds neither of any
std::optional<io::Image> card_pictures(const std::filesystem::path& out, const std::vector<DatasetRow>& rows) {
  const std::size_t count = std::min(kMostTiles, rows.size());
  std::vector<std::optional<render::Tile>> made(count);
  for (std::size_t i = 0; i < count; ++i) made[i] = tile_of(out, rows[i * rows.size() / count]);
  std::vector<render::Tile> tiles;
  for (auto& tile : made) {
    if (tile) tiles.push_back(std::move(*tile));
  }
  if (tiles.empty()) return std::nullopt;
  render::SheetOptions options;
  options.text_height = 9;
  return render::contact_sheet(tiles, options);
}

constexpr char kHead[] = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Dataset card</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #22252a; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; }
th, td { text-align: left; padding: 0.2em 1em 0.2em 0; border-bottom: 1px solid #dde0e5; vertical-align: top; }
td { overflow-wrap: anywhere; }
img { max-width: 100%; } svg { max-width: 100%; height: auto; }
svg rect { fill: #4878a8; } svg text { font-size: 11px; text-anchor: middle; fill: #555b66; }
pre { background: #f4f5f7; padding: 1em; overflow-x: auto; } .note { color: #555b66; }
</style></head><body>
<h1>Dataset card</h1>
)";

std::string html_table(const CardTable& table) {
  std::string html = "<h2>" + html_escaped(table.title) + "</h2>\n";
  if (!table.note.empty()) html += "<p class=\"note\">" + html_escaped(table.note) + "</p>\n";
  html += "<table><tr>";
  for (const std::string& name : table.columns) html += "<th>" + html_escaped(name) + "</th>";
  html += "</tr>\n";
  for (const auto& row : table.rows) {
    html += "<tr>";
    for (const std::string& cell : row) html += "<td>" + html_escaped(cell) + "</td>";
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

/// A table cell: no line breaks, no column ends.
std::string cell_text(const std::string& text) {
  std::string cell;
  for (const char c : text) {
    if (c == '|') cell += '\\';
    cell += c == '\n' || c == '\r' ? ' ' : c;
  }
  return cell;
}

std::string row_text(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + cell_text(cell) + " |";
  return line + "\n";
}

std::string markdown_table(const CardTable& table) {
  std::string text = "## " + table.title + "\n\n";
  if (!table.note.empty()) text += table.note + "\n\n";
  text += row_text(table.columns) + "|";
  for (std::size_t i = 0; i < table.columns.size(); ++i) text += "---|";
  text += "\n";
  for (const auto& row : table.rows) text += row_text(row);
  return text + "\n";
}

}  // namespace

std::vector<HistogramBin> histogram(const std::vector<double>& values, std::size_t most) {
  if (values.empty()) return {};
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  const bool wide = *least > 0.0 && *largest / *least > 100.0;
  const std::vector<double> edges =
      wide ? decade_edges(*least, *largest, most) : equal_edges(*least, *largest, std::max<std::size_t>(2, most));
  std::vector<HistogramBin> bins;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) bins.push_back({edges[i], edges[i + 1], 0});
  for (const double value : values) {
    const auto above = std::upper_bound(edges.begin(), edges.end(), value) - edges.begin();
    const auto bin = std::clamp<std::ptrdiff_t>(above - 1, 0, static_cast<std::ptrdiff_t>(bins.size()) - 1);
    ++bins[static_cast<std::size_t>(bin)].count;
  }
  return bins;
}

std::string histogram_svg(const std::vector<HistogramBin>& bins) {
  if (bins.empty()) return "";
  std::size_t tallest = 1;
  for (const HistogramBin& bin : bins) tallest = std::max(tallest, bin.count);
  constexpr double kWidth = 46, kHeight = 120, kTop = 16, kBottom = 18;
  const double width = kWidth * static_cast<double>(bins.size());
  std::string svg = "<svg viewBox=\"0 0 " + fixed(width, 0) + " " + fixed(kTop + kHeight + kBottom, 0) + "\" width=\"" +
                    fixed(width, 0) + "\" role=\"img\">\n";
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double x = kWidth * static_cast<double>(i);
    const double height = kHeight * static_cast<double>(bins[i].count) / static_cast<double>(tallest);
    svg += "<rect x=\"" + fixed(x + 2, 0) + "\" y=\"" + fixed(kTop + kHeight - height, 1) + "\" width=\"" +
           fixed(kWidth - 4, 0) + "\" height=\"" + fixed(height, 1) + "\"/>";
    if (bins[i].count > 0) {
      svg += "<text x=\"" + fixed(x + kWidth / 2, 0) + "\" y=\"" + fixed(kTop + kHeight - height - 3, 1) + "\">" +
             std::to_string(bins[i].count) + "</text>";
    }
    svg += "<text x=\"" + fixed(x + kWidth / 2, 0) + "\" y=\"" + fixed(kTop + kHeight + 13, 0) + "\">" +
           short_number(bins[i].low) + "</text>\n";
  }
  return svg + "</svg>\n";
}

std::string card_html(const CardFacts& facts, const std::vector<std::string>& columns,
                      const std::vector<std::uint8_t>& picture) {
  std::string html = kHead + html_table({"Counts", "", {"", ""}, facts.counts});
  if (!picture.empty()) {
    html += "<h2>Assets</h2>\n<img alt=\"assets of the dataset with their skeletons\" src=\"data:image/png;base64," +
            base64(picture) + "\">\n";
  }
  for (const CardHistogram& one : facts.histograms) {
    html += "<h2>" + html_escaped(one.title) + "</h2>\n<p class=\"note\">" + one.spread + "</p>\n" +
            histogram_svg(one.bins);
  }
  for (const CardTable& table : facts.tables) {
    if (!table.rows.empty()) html += html_table(table);
  }
  return html + "<h2>Columns of metadata.csv</h2>\n<p>" + joined(columns, ", ", html_escaped) +
         "</p>\n<h2>How it was made</h2>\n<pre>" + html_escaped(facts.settings) + "</pre>\n</body></html>\n";
}

std::string card_markdown(const CardFacts& facts, const std::vector<std::string>& columns, bool picture) {
  std::string text = "# Dataset card\n\n" + markdown_table({"Counts", "", {"", ""}, facts.counts});
  if (picture) text += "## Assets\n\n![assets of the dataset with their skeletons](card.png)\n\n";
  for (const CardHistogram& one : facts.histograms)
    text += "## " + one.title + "\n\n" + one.spread + "\n\n```\n" + histogram_text(one.bins) + "```\n\n";
  for (const CardTable& table : facts.tables) {
    if (!table.rows.empty()) text += markdown_table(table);
  }
  text += "## Columns of metadata.csv\n\n";
  for (std::size_t i = 0; i < columns.size(); ++i) text += (i > 0 ? ", `" : "`") + columns[i] + "`";
  return text + "\n\n## How it was made\n\n```json\n" + facts.settings + "\n```\n";
}

void write_card(const std::filesystem::path& out, const DatasetRows& found, const PrepareSummary& summary,
                const CsvTable& table, const StepPlan& plan) {
  const CardFacts facts = card_facts(found, summary, plan);
  const std::optional<io::Image> sheet = card_pictures(out, found.rows);
  std::vector<std::uint8_t> picture;
  if (sheet) {
    picture = io::encode_png(*sheet);
    io::write_png(out / "card.png", *sheet);
  } else {
    std::error_code ignored;
    std::filesystem::remove(out / "card.png", ignored);
  }
  write_file_atomically(out / "card.md", card_markdown(facts, table.columns, sheet.has_value()));
  write_file_atomically(out / "card.html", card_html(facts, table.columns, picture));
}

}  // namespace anigen::prepare
