#pragma once
/// Errors, configs, logging, random streams, threads, processes and files: what every folder stands on. Errors name
/// file, place and remedy (error.h); every random draw comes from Rng(seed, purpose, index) (random.h); files are
/// written under a temporary name, synced and renamed (files.h).
#include "anigen/core/chart.h"
#include "anigen/core/config.h"
#include "anigen/core/config_fields.h"
#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/job.h"
#include "anigen/core/kernel_form.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
