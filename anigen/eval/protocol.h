#pragma once
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"

namespace anigen::eval {

/// A number of a published table: a metric of metric_table() in that table's unit.
struct ProtocolColumn {
  std::string key, label;
  double factor = 1.0;
};

/// The evaluation of a published work, fixed as a whole: frame, registration, sampling, thresholds and columns
/// (docs/metrics.md, Protocols). All but "anigen" score predictions for a given mesh: both sides are in the
/// frame of the truth, at rest, and nothing is registered.
struct EvaluationProtocol {
  std::string word, title;
  metrics::NormalizationMode normalization = metrics::NormalizationMode::kTruth;
  bool icp = false;
  bool clips_joints = false;  ///< PairSettings::clip_joints
  std::vector<ProtocolColumn> columns;
};

/// anigen, magicarticulate, puppeteer, rignet, unirig, anymate.
const std::vector<EvaluationProtocol>& evaluation_protocols();

/// @throws NotSupportedError for skintokens and tailorrig, of which too little is published; InputError for another
/// word
const EvaluationProtocol& evaluation_protocol(const std::string& word);

/// Sets what the protocol fixes, and the groups of metrics that its columns need.
void apply(const EvaluationProtocol& protocol, PairSettings& settings);

/// Mean over assets that have a number, per method and column, and how many have. Failed and missing assets are counted
/// beside the means, as the published programs leave them out.
Table protocol_table(const Comparison& comparison, const EvaluationProtocol& protocol);

/// Title, one sentence on the frame, and the table.
std::string protocol_markdown(const Comparison& comparison, const EvaluationProtocol& protocol);

}  // namespace anigen::eval
