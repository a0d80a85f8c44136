#include "anigen/eval/protocol.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/eval/metric_table.h"

namespace anigen::eval {

const std::vector<EvaluationProtocol>& evaluation_protocols() {
  using Mode = metrics::NormalizationMode;
  constexpr double kHundredths = 100.0;  // tables of MagicArticulate and Puppeteer are in 10⁻²
  static const std::vector<EvaluationProtocol> kProtocols = {
      {"anigen",
       "AniGen",
       Mode::kCentroidRms,
       true,
       false,
       {{"j2j", "J2J"},
        {"j2b", "J2B"},
        {"b2b", "B2B"},
        {"wasserstein", "W"},
        {"gromov_wasserstein", "GW"},
        {"skin_l1", "skin l1"},
        {"skin_l2", "skin l2"},
        {"skin_kl", "skin KL"},
        {"surface_chamfer", "Chamfer"},
        {"fscore", "F 0.05"},
        {"psnr", "PSNR"},
        {"lpips", "LPIPS"}}},
      {"magicarticulate",
       "MagicArticulate",
       Mode::kTruth,
       false,
       true,
       {{"puppeteer.j2j", "CD-J2J ×10⁻²", kHundredths},
        {"puppeteer.j2b", "CD-J2B ×10⁻²", kHundredths},
        {"puppeteer.b2b", "CD-B2B ×10⁻²", kHundredths}}},
      {"puppeteer",
       "Puppeteer",
       Mode::kTruth,
       false,
       true,
       {{"puppeteer.j2j", "CD-J2J ×10⁻²", kHundredths},
        {"puppeteer.j2b", "CD-J2B ×10⁻²", kHundredths},
        {"puppeteer.b2b", "CD-B2B ×10⁻²", kHundredths},
        {"puppeteer.skin_precision", "precision %", kHundredths},
        {"puppeteer.skin_recall", "recall %", kHundredths},
        {"puppeteer.skin_l1", "L1"}}},
      {"rignet",
       "RigNet",
       Mode::kTruth,
       false,
       false,
       {{"rignet.iou", "IoU %", kHundredths},
        {"rignet.precision", "precision %", kHundredths},
        {"rignet.recall", "recall %", kHundredths},
        {"rignet.j2j", "CD-J2J %", kHundredths},
        {"rignet.j2b", "CD-J2B %", kHundredths},
        {"rignet.b2b", "CD-B2B %", kHundredths},
        {"tree_edit_distance", "tree edits"},
        {"skin_precision", "skin precision %", kHundredths},
        {"skin_recall", "skin recall %", kHundredths},
        {"skin_l1", "skin L1"}}},
      {"unirig",
       "UniRig",
       Mode::kTruthWithJoints,
       false,
       false,
       {{"unirig.j2j", "J2J"}, {"unirig.j2b", "J2B"}, {"unirig.b2b", "B2B"}, {"skin_mae", "skin L1"}}},
      {"anymate",
       "Anymate",
       Mode::kTruth,
       false,
       false,
       {{"anymate_cd", "CD"},
        {"anymate_emd", "EMD"},
        {"anymate_precision", "precision"},
        {"anymate_recall", "recall"},
        {"skin_ce", "CE"},
        {"skin_cos", "Cos"},
        {"skin_mae", "MAE"}}},
  };
  return kProtocols;
}

const EvaluationProtocol& evaluation_protocol(const std::string& word) {
  std::vector<std::string> words;
  for (const EvaluationProtocol& protocol : evaluation_protocols()) {
    if (protocol.word == word) return protocol;
    words.push_back(protocol.word);
  }
  if (word == "skintokens")
    throw NotSupportedError("", "--protocol", "skintokens, of whose evaluation no program or definition is published");
  if (word == "tailorrig")
    throw NotSupportedError("", "--protocol", "TailorRig's files, whose layout is not published");
  throw InputError("", "--protocol", "\"" + word + "\" is none of " + joined(words));
}

void apply(const EvaluationProtocol& protocol, PairSettings& settings) {
  settings.alignment.normalization = protocol.normalization;
  settings.alignment.icp = protocol.icp;
  settings.clip_joints = protocol.clips_joints;
  settings.groups.clear();
  for (const ProtocolColumn& column : protocol.columns) settings.groups.insert(find_metric(column.key)->group);
}

Table protocol_table(const Comparison& comparison, const EvaluationProtocol& protocol) {
  Table table{{"method", "assets", "failed"}, {}};
  for (const ProtocolColumn& column : protocol.columns)
    table.columns.push_back(column.label + " " + arrow(find_metric(column.key)->better));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    std::vector<std::string> row{comparison.methods[m], std::to_string(comparison.ids.size()),
                                 std::to_string(failures(comparison, m))};
    for (const ProtocolColumn& column : protocol.columns) {
      double sum = 0.0;
      std::size_t count = 0;
      for (const PairResult& result : comparison.results[m]) {
        const double value = result.value(column.key);
        if (!std::isfinite(value)) continue;
        sum += value;
        ++count;
      }
      std::string text = count == 0 ? "–" : fixed(column.factor * sum / static_cast<double>(count));
      if (count > 0 && count < comparison.ids.size()) text += " (" + std::to_string(count) + ")";
      row.push_back(std::move(text));
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string protocol_markdown(const Comparison& comparison, const EvaluationProtocol& protocol) {
  std::string frame = "Both sides in the frame of the truth, nothing registered; ";
  if (protocol.icp) frame = "Predictions registered to the truth by their surfaces; ";
  return "## Protocol of " + protocol.title + "\n\n" + frame +
         "means over the assets that have a number, in the units of its tables.\n\n" +
         to_markdown(protocol_table(comparison, protocol));
}

}  // namespace anigen::eval
