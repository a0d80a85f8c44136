#pragma once
/// Procedural creatures: bodies of primitives with skeleton, skin weights, colours and motion. body.h is what a
/// family builds; machines.h lists the families.
#include "anigen/creatures/body.h"
#include "anigen/creatures/machines.h"
#include "anigen/creatures/paint.h"
#include "anigen/creatures/parts.h"
#include "anigen/creatures/surface.h"
#include "anigen/creatures/weights.h"
