#!/usr/bin/env bash
# The recipe for Spark, run on this machine with two workers on 40 recordings, and the table read by the tools of others:
# DuckDB, pandas, Spark. Needs python3 with venv, Java 17 or later, and a network for their packages.
set -euo pipefail
cd "$(dirname "$0")/.."
hil=$PWD/${1:-target/release/hil}
work=$PWD/target/fleet
mkdir -p "$work"
[ -x "$work/venv/bin/python" ] || python3 -m venv "$work/venv"
python=$work/venv/bin/python
"$python" -m pip install --quiet --disable-pip-version-check 'pyspark>=4,<5' 'duckdb>=1' 'pandas>=2,<3' 'pyarrow>=20' 'numpy>=2,<3'

rm -rf "$work"/{jobs,one,spark,killed} && mkdir -p "$work/jobs"
"$python" tests/peers/fleet_jobs.py "$hil" "$work/jobs" 40

begun=$SECONDS
"$hil" diagnose --jobs "$work/jobs/jobs.csv" --out "$work/one" --threads 2 2> "$work/one.log"
echo "one process, two threads: $((SECONDS - begun)) s"

SPARK_HOME=$("$python" -c 'import os, pyspark; print(os.path.dirname(pyspark.__file__))')
export SPARK_HOME PYSPARK_PYTHON=$python SPARK_LOCAL_IP=127.0.0.1
submit() { # OUT
    "$SPARK_HOME/bin/spark-submit" --master 'local-cluster[2,1,1024]' --conf spark.ui.enabled=false --conf spark.driver.host=127.0.0.1 \
        --conf spark.task.maxFailures=100 \
        deploy/spark/diagnose.py "$work/jobs/jobs.csv" "$1" --hil "$hil" --batch 10
}
begun=$SECONDS
submit "$work/spark" 2> "$work/spark.log" | tee "$work/spark.txt" || { tail -30 "$work/spark.log"; exit 1; }
grep -qx '40 jobs' "$work/spark.txt"
echo "Spark, two workers: $((SECONDS - begun)) s, its start counted"
"$python" tests/peers/fleet_rows.py "$work/one" "$work/spark"

# A worker's program is killed now and then, HIL_FLEET_KILLS times: Spark runs its task again, and nothing is lost or twice.
most=${HIL_FLEET_KILLS:-6}
submit "$work/killed" > "$work/killed.txt" 2> "$work/killed.log" &
spark=$!
kills=0
while kill -0 "$spark" 2> /dev/null; do
    sleep 1
    [ "$kills" -lt "$most" ] || continue
    for victim in $(pgrep -f -- "^$hil diagnose --jobs - --out $work/killed" | head -1); do
        kill -9 "$victim" && kills=$((kills + 1))
    done
done
wait "$spark" || { tail -30 "$work/killed.log"; exit 1; }
echo "$kills times kill -9"
"$python" tests/peers/fleet_rows.py "$work/one" "$work/killed"

"$hil" collect "$work/spark" -o "$work/fleet.parquet" --report "$work/fleet.html" --force > /dev/null
cd "$work"
"$python" - << 'READERS'
import duckdb
import pandas
from pyspark.sql import SparkSession

by_duckdb = duckdb.sql("select tag_lot, causes, count(*) from 'fleet.parquet' group by all order by 3 desc").fetchall()
by_pandas = pandas.read_parquet("fleet.parquet").groupby("tag_lot").causes.value_counts()
spark = SparkSession.builder.master("local[1]").config("spark.ui.enabled", "false").getOrCreate()
by_spark = spark.read.parquet("fleet.parquet").groupBy("tag_lot", "causes").count().collect()
one, two, three = ({(lot, cause or ""): int(n) for lot, cause, n in rows} for rows in (by_duckdb, [(*k, n) for k, n in by_pandas.items()], by_spark))
assert one == two == three and sum(one.values()) == 40, (one, two, three)
print("DuckDB, pandas and Spark read the same table:", sum(one.values()), "rows")
READERS
