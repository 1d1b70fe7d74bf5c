//! What is in a foreign log: every column with its unit and its range, and which one is likely to be which channel.

use std::path::Path;

use super::likely::{self, Named};
use super::raw::{Content, RawColumn, Table};
use super::{Channel, Format, Mapping, Reading, RecordingError, Role, mdf4, parquet, scan};

/// Points of a sparkline.
pub const SPARK: usize = 32;

/// A column in a few figures.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ChannelSurvey {
    /// Channel group of an MDF file; empty elsewhere.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub group: String,
    /// Name as in the file.
    pub name: String,
    /// Unit from the name or from the file.
    pub unit: Option<String>,
    /// `numbers`, `time stamps`, `dates`, `texts`, `empty`.
    pub content: &'static str,
    /// Number of values.
    pub values: usize,
    /// Cells without a value.
    pub gaps: usize,
    /// Smallest and largest value, in the column's own unit.
    pub range: Option<(f64, f64)>,
    /// Median step of the column's own time [s]; of MDF, where groups have rasters of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub raster_s: Option<f64>,
    /// First texts of a column of texts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
    /// Course of the values in `SPARK` points; NaN where there is none.
    #[serde(skip)]
    pub spark: Vec<f64>,
}

/// A channel with the column that it is taken from, and why.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Proposal {
    /// The channel.
    pub channel: &'static str,
    /// As after `--map`.
    pub expr: String,
    /// What speaks for it.
    pub why: String,
    /// What to look at before it is believed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caution: Option<String>,
}

/// What is in a log.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Survey {
    /// File name.
    pub file: String,
    /// Line of the header, of a text.
    pub header_row: Option<usize>,
    /// Every column.
    pub channels: Vec<ChannelSurvey>,
    /// What to take for which channel; what is not here was not found.
    pub proposals: Vec<Proposal>,
    /// What was noticed.
    pub notes: Vec<String>,
}

/// Looks at a log; `reading` says header, encoding and what is mapped already.
///
/// # Errors
/// What cannot be read at all, see [`RecordingError`].
pub fn inspect(path: &Path, reading: &Reading) -> Result<Survey, RecordingError> {
    let file = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    if path.is_dir() {
        return Err(RecordingError::format(&file, "is a directory; a recording is wanted"));
    }
    let table = match Format::of(path)? {
        Format::Csv => scan::table(path, &file, reading)?,
        Format::Parquet => parquet::table(path)?,
        Format::Mdf4 => mdf4::table(path, &file)?,
    };
    let proposals = proposals(&table, &reading.map);
    let channels = table.columns.iter().map(|c| surveyed(c, &table)).collect();
    Ok(Survey { file, header_row: table.header_row, channels, proposals, notes: table.notes })
}

impl RawColumn {
    fn named(&self) -> Named {
        let named = likely::named(&self.header);
        Named { unit: self.unit.clone().or(named.unit), ..named }
    }

    /// As a mapping names it.
    fn expr(&self, role: Role) -> String {
        let full = if self.group.is_empty() { self.header.clone() } else { format!("{}/{}", self.group, self.header) };
        let plain = Mapping::parse(&format!("{}={full}", role.name()));
        match plain {
            Ok(mapping) if !mapping.scaled && mapping.second.is_none() && (mapping.unit.is_none() || self.header.ends_with(']')) => full,
            _ => {
                let quote = ['"', '\'', '`'].into_iter().find(|q| !full.contains(*q)).unwrap_or('"');
                let unit = self.named().unit.filter(|u| role.conversion(u).is_ok());
                format!("{quote}{full}{quote}{}", unit.map_or_else(String::new, |u| format!(" [{u}]")))
            }
        }
    }

    fn numbers(&self) -> Option<&[f64]> {
        match &self.content {
            Content::Numbers(values) => Some(values),
            _ => None,
        }
    }

    /// Whether the values can be a time: they grow, but for a few.
    fn is_clock(&self) -> bool {
        match &self.content {
            Content::Stamps(..) => true,
            Content::Numbers(values) => {
                let steps = values.windows(2).filter(|w| w[1] > w[0]).count();
                let equal = values.windows(2).filter(|w| w[1] == w[0]).count();
                values.len() > 2 && steps > 0 && (steps + equal) * 50 >= 49 * (values.len() - 1)
            }
            _ => false,
        }
    }

    fn varies(&self) -> bool {
        self.numbers().is_some_and(|values| {
            let mut finite = values.iter().filter(|v| v.is_finite());
            finite.next().is_some_and(|first| finite.any(|v| v != first))
        })
    }
}

/// What to take for which channel. A column is taken once.
fn proposals(table: &Table, map: &[Mapping]) -> Vec<Proposal> {
    let mut taken: Vec<usize> = Vec::new();
    let mut proposals = Vec::new();
    let columns = &table.columns;
    let named: Vec<Named> = columns.iter().map(RawColumn::named).collect();
    let roles = [
        Role::Time,
        Role::Channel(Channel::Current),
        Role::Channel(Channel::Pressure),
        Role::Channel(Channel::Target),
        Role::Channel(Channel::MeasuredCurrent),
        Role::Channel(Channel::Supply),
        Role::Channel(Channel::OilTemperature),
        Role::Run,
    ];
    let mut group: Option<&str> = None;
    for role in roles {
        if let Some(mapping) = map.iter().find(|m| m.role == role) {
            let why = "as mapped".to_string();
            proposals.push(Proposal { channel: role.name(), expr: mapping.text.clone(), why, caution: None });
            continue;
        }
        // The time of an MDF file is each group's own.
        if role == Role::Time && columns.iter().any(|c| !c.group.is_empty()) {
            continue;
        }
        let fits = |at: usize| match role {
            Role::Time => columns[at].is_clock(),
            Role::Run => matches!(&columns[at].content, Content::Texts(texts) if texts.len() <= 200),
            Role::Channel(_) => columns[at].numbers().is_some(),
        };
        let mut found: Vec<(usize, String)> =
            likely::likely(role, &named).into_iter().filter(|(at, _)| !taken.contains(at) && fits(*at)).collect();
        // Of equals the one that moves, and of MDF groups the one of the command.
        found.sort_by_key(|(at, _)| {
            let constant = matches!(role, Role::Channel(Channel::Current | Channel::Pressure)) && !columns[*at].varies();
            (constant, group.is_some_and(|g| g != columns[*at].group))
        });
        if found.is_empty() && role == Role::Time {
            // A clock without a telling name: the first column that grows.
            found.extend((0..columns.len()).find(|at| fits(*at)).map(|at| (at, "the first column that grows".into())));
        }
        let Some((at, why)) = found.into_iter().next() else { continue };
        let column = &columns[at];
        if role == Role::Channel(Channel::Current) {
            group = Some(&column.group);
        }
        taken.push(at);
        let mut expr = column.expr(role);
        let mut why = why;
        if role == Role::Time
            && let Some(date) = columns.iter().position(|c| matches!(c.content, Content::Dates(_)))
        {
            taken.push(date);
            expr = format!("{} + {expr}", columns[date].expr(role));
            why = format!("a date and a time of day, {why}");
        }
        let stamps = matches!(column.content, Content::Stamps(..));
        let unitless = role != Role::Run && !stamps && named[at].unit.is_none() && column.header != role.name();
        let unknown = named[at].unit.as_ref().filter(|_| !stamps).and_then(|u| role.conversion(u).err());
        let own = role.units().map_or("", |u| u.symbol);
        let caution = match unknown {
            Some(what) => Some(format!("{what}: give the factor to {own}")),
            None if unitless => Some(format!("no unit is given: its numbers are taken as {own}")),
            None => None,
        };
        proposals.push(Proposal { channel: role.name(), expr, why, caution });
    }
    proposals
}

fn surveyed(column: &RawColumn, table: &Table) -> ChannelSurvey {
    let named = column.named();
    let mut survey = ChannelSurvey {
        group: column.group.clone(),
        name: column.header.clone(),
        unit: named.unit,
        content: "empty",
        values: 0,
        gaps: 0,
        range: None,
        raster_s: None,
        texts: Vec::new(),
        spark: Vec::new(),
    };
    match &column.content {
        Content::Numbers(values) | Content::Stamps(values, _) => {
            survey.content = if matches!(column.content, Content::Numbers(_)) { "numbers" } else { "time stamps" };
            let finite = || values.iter().copied().filter(|v| v.is_finite());
            survey.values = finite().count();
            survey.gaps = values.len() - survey.values;
            let range = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |r, v| (r.0.min(v), r.1.max(v)));
            survey.range = (range.0 <= range.1).then_some(range);
            survey.spark = spark(values);
            if !column.group.is_empty() {
                let clock = table.columns.iter().find(|c| c.group == column.group && c.is_clock());
                survey.raster_s = clock.and_then(RawColumn::numbers).map(median_step);
            }
        }
        Content::Dates(first) => {
            survey.content = "dates";
            survey.texts = vec![first.clone()];
        }
        Content::Texts(texts) => {
            survey.content = "texts";
            survey.values = texts.len();
            survey.texts = texts.iter().take(8).cloned().collect();
        }
        Content::Empty => {}
    }
    survey
}

fn median_step(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).filter(|s| s.is_finite()).collect();
    if steps.is_empty() {
        return f64::NAN;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Means over equal parts of the column.
fn spark(values: &[f64]) -> Vec<f64> {
    let points = SPARK.min(values.len());
    (0..points)
        .map(|k| {
            let part = &values[k * values.len() / points..(k + 1) * values.len() / points];
            let finite: Vec<f64> = part.iter().copied().filter(|v| v.is_finite()).collect();
            if finite.is_empty() { f64::NAN } else { finite.iter().sum::<f64>() / finite.len() as f64 }
        })
        .collect()
}

impl Survey {
    /// The mapping that the proposals make, with the header's row where it is not the first line.
    pub fn mapping(&self, encoding: Option<super::Encoding>) -> super::MappingFile {
        let own = |p: &&Proposal| p.expr != p.channel;
        super::MappingFile {
            schema: super::MAPPING_SCHEMA.into(),
            map: self.proposals.iter().filter(own).map(|p| (p.channel.to_string(), p.expr.clone())).collect(),
            select: super::SelectFile::default(),
            read: super::ReadFile { header_row: self.header_row.filter(|row| *row > 1), encoding, input: None },
        }
    }
}
