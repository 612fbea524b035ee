// Settings of the unit `diagnosis`: default, unit, range and help of each, in one place.
#pragma once

#include "core/plugin_sdk.h"
#include "plugins/diagnosis/diagnosis.h"

namespace teres {

struct DiagnosisSettings {
    int num_refits = 5;

    template <class V>
    void visit(V& field) {
        field("num_refits", num_refits, {3, 26}, "offline: effects that are refitted nonlinearly after screening");
    }
};

}  // namespace teres
