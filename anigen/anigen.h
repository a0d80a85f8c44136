#pragma once
/// AniGen as a library: rigged assets in memory, and everything that the programs do with them. Headers here need the
/// standard library and Eigen alone. Every function throws InputError (core/error.h) with the text that the program
/// would print, options by their names here, and Interrupted once its Job was cancelled; it may be called from several
/// threads at once.
///
///   using namespace anigen;
///   Asset fox = engine::load("fox.obj");
///   engine::Rigged rigged = engine::rig(fox);
///   rigged.asset.animations = engine::animate(rigged.asset, {{"walk", "wag"}});
///   engine::save(rigged.asset, "fox.glb");
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/job.h"
#include "anigen/engine/animate.h"
#include "anigen/engine/evaluate.h"
#include "anigen/engine/files.h"
#include "anigen/engine/generator.h"
#include "anigen/engine/prepare.h"
#include "anigen/engine/render.h"
#include "anigen/engine/rig.h"
