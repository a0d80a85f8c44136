#pragma once
/// Whole experiments from one JSON file: a plan of jobs, their runner, tables over seeds, the report. Calls the
/// programs, so it needs no LibTorch.
#include "anigen/experiment/claims.h"
#include "anigen/experiment/command.h"
#include "anigen/experiment/file.h"
#include "anigen/experiment/plan.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/results.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/sheets.h"
