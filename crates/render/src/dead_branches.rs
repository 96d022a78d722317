//! Leaves out of a shader what its switches rule out. Drivers would find that out themselves, but only after they have
//! copied each function to each of its calls and gone through all of it: on software Vulkan that takes a third of the time
//! in which the passes of a first picture are compiled.

use std::collections::HashMap;

use naga::compact::{KeepUnused, compact};
use naga::{
    Arena, BinaryOperator, Block, Expression, Function, Handle, Literal, LocalVariable, Module, Override, Statement,
    UnaryOperator,
};

/// Puts the branch that is taken in the place of each `if` that the switches decide, and leaves out what nothing refers
/// to then. Switches that are not given have the shader's own values.
///
/// # Errors
/// The name of a switch that the shader lacks.
pub fn leave_out(module: &mut Module, switches: &[(&str, u32)]) -> Result<(), String> {
    let is_own = |name: &str| module.overrides.iter().any(|(_, own)| own.name.as_deref() == Some(name));
    if let Some((name, _)) = switches.iter().find(|(name, _)| !is_own(name)) {
        return Err(format!("no switch `{name}`"));
    }
    let mut functions = std::mem::take(&mut module.functions);
    for (_, function) in functions.iter_mut() {
        leave_out_of(function, Switches { module, values: switches });
    }
    module.functions = functions;
    let mut entry_points = std::mem::take(&mut module.entry_points);
    for entry_point in &mut entry_points {
        leave_out_of(&mut entry_point.function, Switches { module, values: switches });
    }
    module.entry_points = entry_points;
    compact(module, KeepUnused::No);
    Ok(())
}

fn leave_out_of(function: &mut Function, switches: Switches<'_>) {
    // Names would keep the expressions of the branches that are gone. Only debuggers show them.
    function.named_expressions.clear();
    let mut known = Locals::new();
    loop {
        let body = std::mem::take(&mut function.body);
        (function.body, _) = live(body, &|condition| switches.decide(&function.expressions, &known, condition));
        let before = known.len();
        known = temporaries(function, &switches, &known);
        if known.len() == before {
            return;
        }
    }
}

/// The values of local variables that have one alone.
type Locals = HashMap<Handle<LocalVariable>, u32>;

/// The temporaries of `&&` and `||`, which naga writes as an `if` that stores into a variable without a name, and reads
/// right after it: those that are given one value alone.
fn temporaries(function: &Function, switches: &Switches<'_>, known: &Locals) -> Locals {
    let mut values: HashMap<Handle<LocalVariable>, Option<u32>> = HashMap::new();
    let mut blocks = vec![&function.body];
    while let Some(block) = blocks.pop() {
        for statement in block.iter() {
            match statement {
                Statement::Store { pointer, value } => {
                    let Expression::LocalVariable(local) = function.expressions[*pointer] else { continue };
                    let value = switches.value(&function.expressions, known, *value);
                    let stored = values.entry(local).or_insert(value);
                    *stored = stored.filter(|stored| Some(*stored) == value);
                }
                Statement::Block(inner) => blocks.push(inner),
                Statement::If { accept, reject, .. } => blocks.extend([accept, reject]),
                Statement::Loop { body, continuing, .. } => blocks.extend([body, continuing]),
                Statement::Switch { cases, .. } => blocks.extend(cases.iter().map(|case| &case.body)),
                _ => {}
            }
        }
    }
    let is_temporary = |local: Handle<LocalVariable>| function.local_variables[local].name.is_none();
    values
        .into_iter()
        .filter(|(local, _)| is_temporary(*local))
        .filter_map(|(local, value)| Some((local, value?)))
        .collect()
}

/// The switches of a shader.
struct Switches<'m> {
    module: &'m Module,
    values: &'m [(&'m str, u32)],
}

impl Switches<'_> {
    fn decide(&self, expressions: &Arena<Expression>, known: &Locals, condition: Handle<Expression>) -> Option<bool> {
        self.value(expressions, known, condition).map(|value| value != 0)
    }

    /// The value of an expression, 0 or 1 of a bool, if it follows from the switches.
    fn value(&self, expressions: &Arena<Expression>, known: &Locals, expression: Handle<Expression>) -> Option<u32> {
        let value = |expression| self.value(expressions, known, expression);
        match expressions[expression] {
            Expression::Literal(Literal::Bool(value)) => Some(value.into()),
            Expression::Literal(Literal::U32(value)) => Some(value),
            Expression::Constant(constant) => self.global(self.module.constants[constant].init),
            Expression::Override(switch) => self.switch(switch),
            Expression::Load { pointer } => match expressions[pointer] {
                Expression::LocalVariable(local) => known.get(&local).copied(),
                _ => None,
            },
            Expression::Unary { op: UnaryOperator::LogicalNot, expr } => value(expr).map(|value| u32::from(value == 0)),
            Expression::Binary { op: BinaryOperator::Equal, left, right } => {
                Some(u32::from(value(left)? == value(right)?))
            }
            Expression::Binary { op: BinaryOperator::NotEqual, left, right } => {
                Some(u32::from(value(left)? != value(right)?))
            }
            _ => None,
        }
    }

    fn global(&self, expression: Handle<Expression>) -> Option<u32> {
        self.value(&self.module.global_expressions, &Locals::new(), expression)
    }

    fn switch(&self, switch: Handle<Override>) -> Option<u32> {
        let own = &self.module.overrides[switch];
        let given = self.values.iter().find(|(name, _)| own.name.as_deref() == Some(*name));
        given.map(|(_, value)| *value).or_else(|| self.global(own.init?))
    }
}

/// The statements of a block that may run, and whether the block always leaves what is around it: nothing may follow then.
fn live(block: Block, known: &impl Fn(Handle<Expression>) -> Option<bool>) -> (Block, bool) {
    let mut kept = Block::new();
    for (statement, span) in block.span_into_iter() {
        let leaves = match statement {
            Statement::If { condition, accept, reject } => match known(condition) {
                Some(holds) => {
                    let (mut taken, leaves) = live(if holds { accept } else { reject }, known);
                    kept.append(&mut taken);
                    leaves
                }
                None => {
                    let [accept, reject] = [accept, reject].map(|branch| live(branch, known).0);
                    kept.push(Statement::If { condition, accept, reject }, span);
                    false
                }
            },
            Statement::Block(inner) => {
                let (inner, leaves) = live(inner, known);
                kept.push(Statement::Block(inner), span);
                leaves
            }
            Statement::Loop { body, continuing, break_if } => {
                let [body, continuing] = [body, continuing].map(|part| live(part, known).0);
                kept.push(Statement::Loop { body, continuing, break_if }, span);
                false
            }
            Statement::Switch { selector, mut cases } => {
                for case in &mut cases {
                    (case.body, _) = live(std::mem::take(&mut case.body), known);
                }
                kept.push(Statement::Switch { selector, cases }, span);
                false
            }
            other => {
                let leaves = matches!(
                    other,
                    Statement::Return { .. } | Statement::Break | Statement::Continue | Statement::Kill
                );
                kept.push(other, span);
                leaves
            }
        };
        if leaves {
            return (kept, true);
        }
    }
    (kept, false)
}

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;

    /// The names of the functions that are left, and the statements of the entry point.
    fn left(switches: &[(&str, u32)], main: &str) -> (Vec<String>, usize) {
        let source = format!("{SHADER} @compute @workgroup_size(1) fn main() {{ {main} }}");
        let mut module = naga::front::wgsl::parse_str(&source).unwrap();
        leave_out(&mut module, switches).unwrap();
        Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).unwrap();
        let names = module.functions.iter().filter_map(|(_, function)| function.name.clone()).collect();
        (names, module.entry_points[0].function.body.len())
    }

    const SHADER: &str = "
        const FIRST = 1u;
        override is_one: bool = false;
        override kind: u32 = FIRST;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        fn one() -> u32 { return out[1]; }
        fn two() -> u32 { return out[2]; }
        fn three() -> u32 { return out[3]; }
    ";

    #[test]
    fn branches_that_are_never_taken_and_what_only_they_call_are_left_out() {
        let main = "
            if is_one { let value = one(); out[0] = value; return; }
            for (var i = 0u; i < 3u; i++) { if i == 1u { if !is_one { out[i] = two(); } else { continue; } } }
            if kind != FIRST && three() == 0u { out[0] = 1u; }";
        assert_eq!(left(&[("is_one", 1), ("kind", 2)], main).0, ["one"]);
        assert_eq!(left(&[("kind", 2)], main).0, ["two", "three"]);
        assert_eq!(left(&[("is_one", 0)], main).0, ["two"]);
    }

    #[test]
    fn a_side_that_decides_and_and_or_leaves_out_the_other_and_what_follows() {
        let main =
            "if is_one || kind == 2u { return; } if kind == 2u && one() == 0u { out[0] = two(); } out[0] = three();";
        assert_eq!(left(&[("is_one", 1)], main).0, [""; 0]);
        assert_eq!(left(&[("kind", 2)], main).0, [""; 0]);
        assert_eq!(left(&[], main).0, ["three"]);
    }

    #[test]
    fn nothing_follows_a_branch_that_always_returns() {
        let (names, statements) = left(&[("is_one", 1)], "{ if is_one { out[0] = 1u; return; } } out[0] = two();");
        assert!(names.is_empty() && statements == 1, "{names:?}, {statements} statements");
    }

    #[test]
    fn conditions_that_no_switch_decides_stay() {
        let main = "var known = false; for (var i = 0u; i < 2u; i++) { if known { out[0] = one(); } known = true; }
            if out[0] == 1u && kind == 1u { out[0] = two(); }";
        assert_eq!(left(&[], main).0, ["one", "two"]);
    }

    #[test]
    fn a_switch_that_a_shader_lacks_is_named() {
        let mut module = naga::front::wgsl::parse_str(SHADER).unwrap();
        assert_eq!(leave_out(&mut module, &[("is_two", 1)]).unwrap_err(), "no switch `is_two`");
    }
}
