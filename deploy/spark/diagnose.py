"""Diagnoses a list of recordings on Spark: each task hands its part of the list to `hil diagnose --jobs -`.

    spark-submit deploy/spark/diagnose.py jobs.csv OUT [--hil hil] [--batch 100] [--models DIR]

OUT and the recordings lie where every worker sees them (a mount of the object store or a shared folder). A worker that is
killed loses nothing: Spark runs its task again, and what has its row already is not done again. Afterwards, anywhere:

    hil collect OUT -o fleet.parquet --report fleet.html
"""
import argparse
import math
import os
import subprocess

import pandas as pd
from pyspark.sql import SparkSession


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("jobs")
    parser.add_argument("out")
    parser.add_argument("--hil", default="hil")
    parser.add_argument("--batch", type=int, default=100, help="recordings a task")
    parser.add_argument("--models")
    args = parser.parse_args()
    base = os.path.abspath(os.path.dirname(args.jobs))
    jobs = pd.read_csv(args.jobs, dtype=str, keep_default_na=False)
    jobs["recording"] = [os.path.join(base, path) for path in jobs["recording"]]
    if "model" in jobs:
        absolute = lambda m: "identify:" + os.path.join(base, m[9:]) if m.startswith("identify:") else os.path.join(base, m) if m else m
        jobs["model"] = [absolute(model) for model in jobs["model"]]
    command = [args.hil, "diagnose", "--jobs", "-", "--out", os.path.abspath(args.out), "--threads", "1"]
    command += ["--models", os.path.abspath(args.models)] if args.models else []

    def task(parts):
        for part in parts:
            done = subprocess.run(command, input=part.to_csv(index=False), capture_output=True, text=True)
            # 3: some inputs are unusable, and their rows say why; anything else is for Spark to try again
            if done.returncode not in (0, 3):
                raise RuntimeError(done.stderr[-2000:])
            yield pd.DataFrame({"jobs": [len(part)]})

    spark = SparkSession.builder.appName("hil diagnose").config("spark.sql.execution.arrow.maxRecordsPerBatch", args.batch).getOrCreate()
    tasks = math.ceil(len(jobs) / args.batch)
    done = spark.createDataFrame(jobs).repartition(tasks).mapInPandas(task, "jobs long").groupBy().sum().collect()[0][0]
    print(f"{done} jobs")
    spark.stop()


if __name__ == "__main__":
    main()
