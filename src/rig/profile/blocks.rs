//! The checks of one transaction: its function, its gapless blocks of registers, and its proof of freshness.

use super::context::Context;
use super::cycle_file::*;
use super::file::*;
use super::parts::*;
use super::signal::{Signal, SignalName};
use super::template::Template;

/// Steps by which the quantity grows: with none, four requests in a row can be told apart.
const STEPS: u16 = 3;

/// Checks the transaction at `index`; `before` are those that come earlier in the slot.
pub(super) fn transaction(
    c: &Context,
    index: usize,
    t: &TransactionFile,
    file: &ProfileFile,
    transport: &Transport,
    signals: &[Signal],
    before: &[Transaction],
) -> Result<Transaction, ProfileError> {
    let key = |k: &str| format!("cycle.transaction.{k}");
    let fail = |k: &str, message: String| Err(c.error(&key(k), format!("transaction {}: {message}", index + 1)));
    if transport.kind == TransportKind::Line {
        return line_transaction(c, index, t, signals);
    }
    if t.request.is_some() || t.reply.is_some() || t.terminator.is_some() || t.checksum != Checksum::None {
        return fail("request", "request, reply, terminator and checksum belong to `transport.kind = \"line\"`".into());
    }
    let Some(function) = t.function.filter(|f| [3, 4, 6, 16, 23].contains(f)) else {
        return fail("function", "allowed: 3, 4, 6, 16, 23".into());
    };
    if !file.transport.functions.contains(&function) {
        return fail("function", format!("function {function} is not among `transport.functions`"));
    }
    let (writes, reads) = (matches!(function, 6 | 16 | 23), matches!(function, 3 | 4 | 23));
    if writes == t.write.is_empty() || reads == t.read.is_empty() {
        return fail(
            "function",
            format!(
                "function {function} {}, so `write` and `read` must say so",
                match (writes, reads) {
                    (true, true) => "writes and reads",
                    (true, false) => "only writes",
                    _ => "only reads",
                }
            ),
        );
    }
    let write = block(c, index, "write", &t.write, signals, Table::Holding)?;
    let read = block(c, index, "read", &t.read, signals, if function == 4 { Table::Input } else { Table::Holding })?;
    if function == 6 && write.as_ref().is_some_and(|b| b.words != 1) {
        return fail("write", "function 6 writes one register; use 16 for more".into());
    }
    let mut units = write.iter().chain(&read).flat_map(|b| &b.signals).map(|i| signals[*i].unit_id);
    let unit_id = units.next().unwrap_or(transport.unit);
    if units.any(|u| u != unit_id) {
        return fail("read", "all signals of a transaction must have the same unit id".into());
    }
    let step = read.iter().flat_map(|b| &b.signals).map(|i| signals[*i].words()).max().unwrap_or(1);
    let checked = Transaction { function, unit_id, write, read, freshness: t.freshness, spare: t.spare, step, line: None };
    freshness(c, index, &checked, transport, signals, before)?;
    Ok(checked)
}

fn freshness(
    c: &Context,
    index: usize,
    t: &Transaction,
    transport: &Transport,
    signals: &[Signal],
    before: &[Transaction],
) -> Result<(), ProfileError> {
    let fail = |message: String| Err(c.error("cycle.transaction.freshness", format!("transaction {}: {message}", index + 1)));
    let tcp = transport.kind == TransportKind::Tcp;
    let gateway = transport.kind == TransportKind::TcpGateway;
    if (t.spare > 0) != (t.freshness == Freshness::Quantity) {
        return fail("`spare` registers and `freshness = \"quantity\"` belong together".into());
    }
    match t.freshness {
        Freshness::TransactionId if gateway => fail(
            "the transaction id is that of the gateway, which gives it back also with an old reply of the device; allowed here: echo, quantity, counter, none".into(),
        ),
        Freshness::TransactionId if !tcp => fail("only Modbus TCP has a transaction id; allowed here: echo, quantity, none".into()),
        Freshness::Counter if !tcp && !gateway => fail(
            "a late reply carries a counter that was never seen, so on this line a counter alone proves nothing; use echo or quantity, the counter is checked beside it".into(),
        ),
        Freshness::Counter if !reads(t, signals, SignalName::Counter) => fail("the block that is read has no `counter`".into()),
        Freshness::Quantity if t.read.is_none() || t.write.is_some() => fail("only a transaction that reads and does not write can vary the quantity".into()),
        Freshness::Quantity if t.spare < STEPS * t.step => {
            fail(format!("`spare` = {}: {} registers behind the block must be readable, so that four requests differ", t.spare, STEPS * t.step))
        }
        Freshness::Echo if t.function == 16 => Ok(()),
        Freshness::Echo if t.function == 6 => Ok(()),
        Freshness::Echo => {
            let writers = before.iter().chain([t]).filter(|w| w.unit_id == t.unit_id);
            let written: Vec<usize> = writers.filter_map(|w| w.write.as_ref()).flat_map(|b| b.signals.clone()).collect();
            let echoed = t.read.iter().flat_map(|b| &b.signals).any(|i| {
                written.contains(i) && matches!(signals[*i].name, SignalName::Setpoint | SignalName::Token)
            });
            if echoed { Ok(()) } else { fail("no `setpoint` or `token` that this slot writes is read back here".into()) }
        }
        _ => Ok(()),
    }
}

fn reads(t: &Transaction, signals: &[Signal], name: SignalName) -> bool {
    t.read.iter().flat_map(|b| &b.signals).any(|i| signals[*i].name == name)
}

fn block(c: &Context, index: usize, k: &str, names: &[String], signals: &[Signal], table: Table) -> Result<Option<Block>, ProfileError> {
    let key = format!("cycle.transaction.{k}");
    let fail = |message: String| c.error(&key, format!("transaction {}: {message}", index + 1));
    let mut indices = Vec::new();
    for name in names {
        let Some(found) = signals.iter().position(|s| s.name.as_str() == name) else {
            let known: Vec<&str> = signals.iter().map(|s| s.name.as_str()).collect();
            return Err(fail(format!("no signal `{name}`; the profile has: {}", known.join(", "))));
        };
        if k == "write" && !matches!(signals[found].name, SignalName::Setpoint | SignalName::Control | SignalName::Token) {
            return Err(fail(format!("`{name}` is not written; allowed: setpoint, control, token")));
        }
        if signals[found].table != table {
            return Err(fail(format!(
                "`{name}` is not in the {} table, which this function works on",
                if table == Table::Input { "input" } else { "holding" }
            )));
        }
        indices.push(found);
    }
    let Some(first) = indices.first() else { return Ok(None) };
    let address = signals[*first].address;
    let mut next = u32::from(address);
    for i in &indices {
        if u32::from(signals[*i].address) != next {
            return Err(fail(format!(
                "`{}` is at register {}, but the block goes on at {next}: it must be gapless and in order",
                signals[*i].name, signals[*i].address
            )));
        }
        next += u32::from(signals[*i].words());
    }
    let words = next - u32::from(address);
    if words > 100 || next > 65_536 {
        return Err(fail(format!("{words} registers from {address} are more than one frame or the table holds")));
    }
    Ok(Some(Block { address, words: words as u16, signals: indices }))
}

fn line_transaction(c: &Context, index: usize, t: &TransactionFile, signals: &[Signal]) -> Result<Transaction, ProfileError> {
    let fail = |k: &str, message: String| c.error(&format!("cycle.transaction.{k}"), format!("transaction {}: {message}", index + 1));
    if t.function.is_some() || !t.write.is_empty() || !t.read.is_empty() || t.spare > 0 {
        return Err(fail("function", "a line driver has `request` and `reply`, no functions and registers".into()));
    }
    let terminator = t.terminator.as_deref().unwrap_or("\r\n");
    let template = |k: &str, text: &Option<String>| {
        let text = text.as_deref().ok_or_else(|| fail(k, "missing".into()))?;
        Template::parse(text, terminator, t.checksum).map_err(|message| fail(k, message))
    };
    let (request, reply) = (template("request", &t.request)?, template("reply", &t.reply)?);
    for (k, template) in [("request", &request), ("reply", &reply)] {
        if let Some(name) = template.signals().find(|n| signals.iter().all(|s| s.name != *n)) {
            return Err(fail(k, format!("`{name}` is not among the profile's signals")));
        }
    }
    let echoed = request.signals().any(|n| n == SignalName::Token) && reply.signals().any(|n| n == SignalName::Token);
    match t.freshness {
        Freshness::None => {}
        Freshness::Echo if echoed => {}
        Freshness::Echo => return Err(fail("freshness", "`{token}` must be in the request and in the reply".into())),
        _ => return Err(fail("freshness", "allowed for a line driver: echo, none".into())),
    }
    Ok(Transaction {
        function: 0,
        unit_id: 0,
        write: None,
        read: None,
        freshness: t.freshness,
        spare: 0,
        step: 1,
        line: Some(LineExchange { request, reply }),
    })
}
