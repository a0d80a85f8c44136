#pragma once
/// Training: the loop, optimisers, checkpoints, metrics; stages/ holds the losses of each stage, distributed/ several
/// processes. trainer.h runs a Stage (stage.h); train_command.h is what anigen-train calls.
#include "anigen/train/export_run.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/optimizer.h"
#include "anigen/train/options.h"
#include "anigen/train/parameters.h"
#include "anigen/train/pictures.h"
#include "anigen/train/stage.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer.h"
#include "anigen/train/trainer_state.h"
#include "anigen/train/warm_start.h"
