#pragma once
/// Evaluation: pairs of prediction and ground truth, all metrics of a pair, comparison of methods, reports,
/// inspection of files. pair.h computes the metrics of one pair; comparison.h runs many pairs of several methods.
#include "anigen/eval/comparison.h"
#include "anigen/eval/comparison_report.h"
#include "anigen/eval/describe.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/eval/inspect.h"
#include "anigen/eval/lint_files.h"
#include "anigen/eval/metric_table.h"
#include "anigen/eval/pair.h"
#include "anigen/eval/pairs.h"
#include "anigen/eval/pairs_csv.h"
#include "anigen/eval/protocol.h"
#include "anigen/eval/skeleton_groups.h"
#include "anigen/eval/skin_baselines.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/eval/skin_intervals.h"
