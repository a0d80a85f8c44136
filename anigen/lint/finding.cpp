#include "anigen/lint/finding.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/text.h"

namespace anigen::lint {

namespace {

const Words<Severity>& severity_words() {
  static const Words<Severity> words = {
      {Severity::kNote, "note"}, {Severity::kWarning, "warning"}, {Severity::kError, "error"}};
  return words;
}

Json number_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

std::string place_text(const Place& place) {
  if (place.kind.empty()) return "";
  std::string text = place.kind + " " + std::to_string(place.index);
  if (!place.name.empty()) text += " " + place.name;
  return text + " (" + significant(place.position.x(), 3) + ", " + significant(place.position.y(), 3) + ", " +
         significant(place.position.z(), 3) + ")";
}

}  // namespace

std::string to_string(Severity severity) { return word_of(severity_words(), severity); }

Severity parse_severity(const std::string& word) { return value_of(severity_words(), word, "severity"); }

std::size_t RigLint::count(Severity least) const {
  return static_cast<std::size_t>(
      std::count_if(findings.begin(), findings.end(), [least](const LintFinding& f) { return f.severity >= least; }));
}

const LintFinding* RigLint::find(const std::string& code) const {
  const auto found = std::find_if(findings.begin(), findings.end(), [&](const auto& f) { return f.code == code; });
  return found == findings.end() ? nullptr : &*found;
}

Json to_json(const RigLint& lint) {
  Json json = {{"findings", Json::array()}, {"figures", lint.figures}};
  for (const LintFinding& finding : lint.findings) {
    Json entry = {{"code", finding.code},
                  {"severity", to_string(finding.severity)},
                  {"count", finding.count},
                  {"share", number_or_null(finding.share)}};
    const Place& place = finding.place;
    if (!place.kind.empty()) {
      entry["place"] = {
          {"kind", place.kind}, {"index", place.index}, {"name", place.name}, {"position", Json::array()}};
      for (const double x : place.position) entry["place"]["position"].push_back(number_or_null(x));
    }
    entry["sentence"] = finding.sentence;
    json["findings"].push_back(std::move(entry));
  }
  return json;
}

Table finding_table(const RigLint& lint) {
  Table table{{"severity", "code", "count", "share", "worst place", "finding"}, {}};
  for (const LintFinding& f : lint.findings) {
    table.rows.push_back(
        {to_string(f.severity), f.code, std::to_string(f.count), fixed(f.share, 3), place_text(f.place), f.sentence});
  }
  return table;
}

}  // namespace anigen::lint
