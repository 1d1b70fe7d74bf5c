"""Runs an exported FMU 2.0 in a second importer, libcosim, step by step, and compares with what `hil simulate` says.

    python second_importer.py HIL LIBRARY FOLDER MODEL.toml ..
"""
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
from fmu import ALLOWED, STEP_S, called, drive
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

CURRENT, PRESSURE = 1, 10


def main():
    hil, library, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve(), Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    t, current = drive(30.0)
    record = folder / "drive.csv"
    np.savetxt(record, np.column_stack([t, current]), delimiter=",", header="time_s,current_a", comments="", fmt=["%.2f", "%.6f"])
    wrong = 0
    log_output_level(CosimLogLevel.WARNING)
    for model in map(Path, sys.argv[4:]):
        simulated, fmu = folder / "simulated.parquet", folder / f"{model.stem}.fmu"
        called(hil, "simulate", record, "--model", model, "-o", simulated, "--force")
        called(hil, "export", model, "-o", fmu, "--library", library, "--force")
        want = parquet.read_table(simulated)["pressure_bar"].to_numpy()
        execution = CosimExecution.from_step_size(step_size=int(STEP_S * 1e9))
        slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="valve"))
        observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
        execution.add_observer(observer)
        execution.add_manipulator(manipulator)
        execution.real_initial_value(slave, CURRENT, float(current[0]))
        worst = 0.0
        for k in range(len(current) - 1):
            manipulator.slave_real_values(slave, [CURRENT], [float(current[k])])
            if not execution.step():
                sys.exit(f"{model.stem}: step {k} was refused")
            worst = max(worst, abs(observer.last_real_values(slave, [PRESSURE])[0] - want[k + 1]))
        print(f"{model.stem:32s} libcosim  differs by {worst:.1e} bar")
        wrong += not worst <= ALLOWED
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
