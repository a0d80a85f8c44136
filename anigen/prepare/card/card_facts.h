#pragma once
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "anigen/prepare/card/histogram.h"
#include "anigen/prepare/run/dataset_rows.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// A small table of the card: header, then rows.
struct CardTable {
  std::string title;
  std::string note;  ///< a sentence under it; may be empty
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

struct CardHistogram {
  std::string title;
  Spread spread;
  std::vector<HistogramBin> bins;
};

/// Everything the card says, before it is Markdown or HTML.
struct CardFacts {
  std::vector<std::pair<std::string, std::string>> counts;
  std::vector<CardTable> tables;  ///< without rows: left out
  std::vector<CardHistogram> histograms;
  std::string settings;  ///< the plan as JSON
};

CardFacts card_facts(const DatasetRows& found, const StepPlan& plan, const QualityLimits& limits);

}  // namespace anigen::prepare
