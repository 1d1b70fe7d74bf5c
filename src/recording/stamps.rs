//! Time stamps: date and time in one cell or in two, time of day over midnight, as seconds since the first.

use jiff::civil::{Date, DateTime, Time};

/// Nanoseconds of a second, and of a day.
const SECOND_NS: i128 = 1_000_000_000;
const DAY_NS: i128 = 86_400 * SECOND_NS;

/// Which number of `03/04/2026` is the day.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    DayFirst,
    MonthFirst,
}

/// Reads stamps (`2026-03-01 12:00:00.010`, `01.03.2026 12:00:00,010`, `12:00:00.010`, with or without offset) as seconds
/// since the first.
#[derive(Default)]
pub(super) struct Stamps {
    start_ns: Option<i128>,
    /// The first stamp, as it stands in the file.
    pub first: String,
    /// Number of stamps read.
    pub count: usize,
    /// How often a time of day without a date passed midnight.
    pub midnights: usize,
    previous_ns: i128,
    date: Dates,
}

impl Stamps {
    /// Seconds since the first stamp; `None` where the cell holds none.
    pub fn of(&mut self, cell: &[u8]) -> Option<f64> {
        let text = std::str::from_utf8(cell).ok()?;
        let point = text.replace(',', ".");
        let ns = match instant(&point) {
            Some(ns) => ns,
            None => match point.split_once(' ').and_then(|(date, time)| self.date_and_time(date, time)) {
                Some(ns) => ns,
                None => self.of_day(time_of_day(&point)?),
            },
        };
        Some(self.since_first(ns, text))
    }

    /// The same for a date and a time of day in two cells.
    pub fn of_two(&mut self, date: &[u8], time: &[u8]) -> Option<f64> {
        let (date, time) = (std::str::from_utf8(date).ok()?, std::str::from_utf8(time).ok()?);
        let ns = self.date_and_time(date, &time.replace(',', "."))?;
        Some(self.since_first(ns, &format!("{date} {time}")))
    }

    fn since_first(&mut self, ns: i128, text: &str) -> f64 {
        let start = *self.start_ns.get_or_insert_with(|| {
            self.first = text.into();
            ns
        });
        self.previous_ns = ns;
        self.count += 1;
        (ns - start) as f64 * 1e-9
    }

    fn date_and_time(&mut self, date: &str, time: &str) -> Option<i128> {
        let of_day = time_of_day(time)?;
        Some(i128::from(self.date.days(date)?) * DAY_NS + of_day)
    }

    /// A time of day goes on over midnight: a step back of more than half a day is one forward to the next day.
    fn of_day(&mut self, ns: i128) -> i128 {
        let ns = ns + self.midnights as i128 * DAY_NS;
        if self.start_ns.is_some() && self.previous_ns - ns > DAY_NS / 2 {
            self.midnights += 1;
            return ns + DAY_NS;
        }
        ns
    }
}

/// A stamp with date and time as ISO 8601 and its relatives write it.
fn instant(text: &str) -> Option<i128> {
    if let Ok(stamp) = text.parse::<jiff::Timestamp>() {
        return Some(stamp.as_nanosecond());
    }
    let stamp = text.parse::<DateTime>().ok()?;
    // A bare date is a date and no time of its first moment.
    text.contains(':').then_some(())?;
    Some(stamp.to_zoned(jiff::tz::TimeZone::UTC).ok()?.timestamp().as_nanosecond())
}

fn time_of_day(text: &str) -> Option<i128> {
    let time = match text.parse::<Time>() {
        Ok(time) if text.contains(':') => time,
        _ => Time::strptime("%I:%M:%S%.f %p", text).ok()?,
    };
    Some(time.duration_since(Time::midnight()).as_nanos())
}

/// Dates as days since the first one.
#[derive(Default)]
struct Dates {
    /// The text that was read last, with its days: most rows repeat it.
    last: Option<(String, i64)>,
    /// The first date under each order that it allows.
    first: Vec<(Order, Date)>,
}

impl Dates {
    fn days(&mut self, text: &str) -> Option<i64> {
        if let Some((last, days)) = &self.last
            && last == text
        {
            return Some(*days);
        }
        let read = readings(text);
        if read.is_empty() {
            return None;
        }
        let days = if self.first.is_empty() {
            self.first = read;
            0
        } else {
            // A log is short: of two orders the one that makes it so, and that one from then on.
            let since = |&(order, first): &(Order, Date)| {
                let date = read.iter().find(|r| r.0 == order)?.1;
                Some((order, i64::from(first.until(date).ok()?.get_days())))
            };
            let (order, days) = self.first.iter().filter_map(since).min_by_key(|(_, days)| (*days < 0, days.abs()))?;
            self.first.retain(|f| f.0 == order);
            days
        };
        self.last = Some((text.into(), days));
        Some(days)
    }
}

/// Whether a text is a date alone.
pub(super) fn is_date(text: &str) -> bool {
    !readings(text).is_empty()
}

/// What a date can mean: `2026-03-01` and `01.03.2026` one thing, `03/01/2026` perhaps two.
fn readings(text: &str) -> Vec<(Order, Date)> {
    let parts: Vec<i16> = match text.split(['.', '-', '/']).map(|p| p.trim().parse::<i16>()).collect() {
        Ok(parts) => parts,
        Err(_) => return Vec::new(),
    };
    let [a, b, c] = parts[..] else { return Vec::new() };
    let date = |year: i16, month: i16, day: i16| {
        let year = if (0..100).contains(&year) { year + 2000 } else { year };
        Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok()
    };
    let all = if a > 31 {
        vec![(Order::DayFirst, date(a, b, c))]
    } else if text.contains('/') {
        vec![(Order::DayFirst, date(c, b, a)), (Order::MonthFirst, date(c, a, b))]
    } else {
        vec![(Order::DayFirst, date(c, b, a))]
    };
    all.into_iter().filter_map(|(order, date)| Some((order, date?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(cells: &[&str]) -> Vec<f64> {
        let mut stamps = Stamps::default();
        cells.iter().map(|c| stamps.of(c.as_bytes()).unwrap_or(f64::NAN)).collect()
    }
    fn read_two(cells: &[(&str, &str)]) -> Vec<f64> {
        let mut stamps = Stamps::default();
        cells.iter().map(|c| stamps.of_two(c.0.as_bytes(), c.1.as_bytes()).unwrap_or(f64::NAN)).collect()
    }

    #[test]
    fn a_time_of_day_goes_on_over_midnight() {
        assert_eq!(read(&["23:59:59,500", "23:59:59,750", "00:00:00,000", "00:00:00,250"]), [0.0, 0.25, 0.5, 0.75]);
        assert_eq!(read(&["11:59:59.5 PM", "12:00:00.0 AM"]), [0.0, 0.5]);
        // Twice, and a single wrong stamp is no midnight.
        assert_eq!(read(&["20:00:00", "04:00:00", "20:00:00", "04:00:00"]), [0.0, 28_800.0, 86_400.0, 115_200.0]);
        assert_eq!(read(&["12:00:01", "12:00:00"]), [0.0, -1.0]);
    }

    #[test]
    fn date_and_time_stand_in_two_cells_or_in_one() {
        let wanted = [0.0, 0.01];
        let near = |found: Vec<f64>| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(near(read_two(&[("28.02.2026", "23:59:59,990"), ("01.03.2026", "00:00:00,000")])));
        assert!(near(read(&["28.02.2026 23:59:59,990", "01.03.2026 00:00:00,000"])));
        assert!(near(read(&["2026/02/28 23:59:59.990", "2026/03/01 00:00:00"])));
        assert!(near(read_two(&[("2/28/26", "11:59:59.990 PM"), ("3/1/26", "12:00:00.000 AM")])));
    }

    #[test]
    fn of_two_orders_of_a_date_the_one_that_makes_the_log_short() {
        assert_eq!(read_two(&[("03/01/2026", "12:00:00"), ("03/02/2026", "12:00:00")]), [0.0, 86_400.0]);
        assert_eq!(read_two(&[("01/03/2026", "12:00:00"), ("02/03/2026", "12:00:00")]), [0.0, 86_400.0]);
        assert!(read(&["yesterday", "31.02.2026 12:00:00", "2026-03-01"]).iter().all(|t| t.is_nan()));
    }
}
